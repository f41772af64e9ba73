"""Dipoles, or any degrees, in bins of redshift: are the coefficients the same at all redshifts?"""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial, reduce
from itertools import pairwise
from typing import Any, Literal, cast

import numpy as np
from scipy.linalg import block_diag

from fit.distances import calibrate_if_known, motions_per_velocity
from fit.methods import estimate
from fit.normal import NormalEquations, normal_equations, solve
from fit.redshift._solution import FLOW_MATTERS, BinnedSolution, find_equality_chi2, find_slope_chi2, make_shared_flow
from fit.results.quality import ErrorSource
from fit.results.solution import Solution
from fit.secular_parallax import DistanceModel
from vsh import Coefficients
from vsh.basis import harmonics
from vsh.classes import Classes
from vsh.field import Field, multiply_weights
from vsh.io.parts import Parts, add_sums, apply_step, as_parts, check_fields_or_parts, weighted_quantiles
from vsh.models.cosmology import usable_mask, velocity_in_frame, with_redshift
from vsh.models.flows import LinearTheory
from vsh.modes import KINDS, Modes, as_modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError, EmptyFieldError, ParameterError
from vsh.tools.notes import drop_empty_notes, merge_notes
from vsh.tools.types import ArrayLike, FloatArray, Rng
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector


@arguments.accepts(field=check_fields_or_parts)
def binned(
    field: Field | Parts | Iterable[Field],
    modes: Modes | int,
    edges: ArrayLike | int,
    *,
    shared_higher_degrees: bool = False,
    redshift_frame: str | None = None,
    peculiar_dispersion: float | None = None,
    flows: Literal["linear"] | LinearTheory | None = "linear",
    n_modes: int = 250,
    method: str | None = None,
    value: float | str | None = None,
    rng: Rng = 1,
    threads: int | None = None,
) -> BinnedSolution:
    """Fit the same modes in bins of redshift.

    Parameters
    ----------
    field : Field, Parts or iterable of Fields
        A catalogue in parts is read once if the edges are given and three times otherwise, and twice more if the frame
        of the redshifts is known. Redshifts of a stream are taken as "true". Sources without a usable redshift are left
        out; a note counts and names them.
    modes : Modes, or the degree lmax
        What to fit.
    edges : (B + 1,) array, or int
        Rising; or the number of bins, of equal information. A bin holds z_low ≤ z < z_high.
    shared_higher_degrees : bool
        Fit one set of coefficients above degree 1 to all bins.
    redshift_frame : str, optional
        "heliocentric", "cmb", "local-group" or "true". Default: the frame that the field declares, "true" if it
        declares none. The frame affects the mean of 1/d of each bin, but not the assignment of sources to bins.
    peculiar_dispersion : float, optional
        Dispersion of peculiar velocities in addition to the flows, in the redshifts (unless these are "true") and in
        the errors. Default: 150; with flows=None 750, in the redshifts alone. [km/s]
    flows : "linear", LinearTheory or None
        Coherent flows of nearby galaxies, which add to the errors of the bins and correlate them. Default: "linear",
        linear theory with Planck's parameters. With None, bins of nearby galaxies differ significantly because of flows
        alone.
    n_modes : int
        Unknowns of the flow.
    method, value
        The estimator, as for `fit.estimate`: one that weighs or clips sources, "recommended" unless given. A stream,
        and near galaxies, which share flows, are fitted by "least-squares".
    rng : Generator or int
        As for `fit.estimate`.
    threads : int, optional
        How many; one a core unless given.

    Raises
    ------
    ParameterError
        If the edges do not rise, or are too few; or if the method cannot be used for these sources.
    DegeneracyError
        If a bin is empty, or cannot separate the modes; or if the robust fit does not settle.
    FieldError
        If there are no redshifts.
    """
    modes = as_modes(modes)
    if isinstance(edges, (str, dict)) or np.ndim(edges) == 0:
        if not isinstance(field, Field | Parts):
            raise ParameterError("bins of equal information need the whole field, or parts: give their edges")
        edges = equal_information_edges(field, cast(int, edges))
    edges = arguments.float_array("edges", edges)
    if edges.ndim != 1 or len(edges) < 2:
        raise ParameterError(f"the edges of redshift bins rise and are two at least, not {edges.tolist()}")
    if not (np.diff(edges) > 0).all():
        fall = int(np.argmin(np.diff(edges) > 0))
        raise ParameterError(
            f"the edges of redshift bins rise from one to the next, not {edges[fall]} to {edges[fall + 1]}"
        )
    n_bins = len(edges) - 1
    bin_sums: dict[Any, Any]
    theory, calibration = DistanceModel(flows=flows).flow, None
    is_scaled = True
    remarks: tuple[str, ...] = ()
    if method is None:
        assumed_theory = DistanceModel().flow if theory is None else theory
        is_far = isinstance(field, Field | Parts) and not _has_relevant_flows(field, edges, assumed_theory)
        method = "recommended" if is_far else "least-squares"
    elif method != "least-squares":
        if not isinstance(field, Field | Parts):
            raise ParameterError(f"the method {method} needs the whole field, or parts")
        if _has_relevant_flows(field, edges, theory):
            raise ParameterError(f"near galaxies share flows: their bins are fitted by least-squares, not {method}")
    theory = theory if method == "least-squares" else None  # sources of other methods are too far for flows
    if method == "clip":
        clipped = estimate(field, modes, method, value, rng=rng)
        field, remarks = clipped.sources, (f"clipped {clipped.n_clipped} sources ({method})",)
    is_weighted = method not in ("least-squares", "clip")
    flow = None if theory is None else make_shared_flow(field, edges, theory, peculiar_dispersion, n_modes)
    if isinstance(field, Field | Parts):
        radial_dispersion = peculiar_dispersion if flow is None else float(np.hypot(flow.dispersion, flow.theory.sigma))
        calibration = calibrate_if_known(field, redshift_frame, radial_dispersion)
    sum_normals = partial(normal_equations, threads=threads)
    sum_up = partial(_sum_by_bin, edges=edges, modes=modes, calibration=calibration, flow=flow, sum_normals=sum_normals)
    if isinstance(field, Parts):
        bin_sums = field.sum(sum_up, roles=("redshift",), words="bins of redshift")
    else:
        bin_sums = reduce(add_sums, map(sum_up, [field] if isinstance(field, Field) else field), {})
    for i in range(n_bins):
        if i not in bin_sums:
            raise DegeneracyError(f"bin {i + 1} of {n_bins}, {_label_bins(edges)[i]}, is empty: choose other edges")
    sums = np.array([bin_sums[i][0] for i in range(n_bins)])
    counts = sums[:, 0].astype(int)
    catalogue_normals = normals = [bin_sums[i][1] for i in range(n_bins)]
    if is_weighted:
        normals, is_scaled, remarks = _compute_weighted_normals(field, modes, edges, counts, method, value, rng)
    notes = [*drop_empty_notes(merge_notes(*bin_sums.get("notes", ()))), *remarks]
    if bin_sums.get("outside"):
        notes.append(f"left out {bin_sums['outside']} sources with redshifts outside {edges[0]:g} … {edges[-1]:g}")
    flow_columns = None if flow is None else [bin_sums[i][2] for i in range(n_bins)]
    solve_bins = _solve_jointly if shared_higher_degrees and modes.lmax > 1 else _solve_each_bin
    solutions, covariance, free_modes, flow_covariance = solve_bins(normals, edges, flow_columns)
    if not is_scaled:  # errors are of the residuals, and χ² is still that of the catalogue's
        pairs = zip(solutions, catalogue_normals, strict=True)
        solutions = [replace(solution, chi2=_compute_chi2(normal, solution.values)) for solution, normal in pairs]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean_inverse_distance = sums[:, 3] / sums[:, 4]
    return BinnedSolution(
        edges=edges,
        solutions=solutions,
        normals=normals,
        redshift=sums[:, 2] / sums[:, 1],
        counts=counts,
        covariance=covariance,
        free=free_modes,
        mean_inverse_distance=mean_inverse_distance,
        notes=tuple(notes),
        flow_covariance=flow_covariance,
        flow="" if flow is None else flow.description,
        is_scaled=is_scaled,
    )


def _has_relevant_flows(field, edges, theory):
    """Return whether sources share flows enough to change the tests of their bins."""
    if theory is None:
        return False
    return binned(field, 1, edges, flows=theory, method="least-squares").flow_share > FLOW_MATTERS


#: From so many sources on a bin has weights of its own; and so many it needs for those of a robust fit. With 7 sources,
#: errors over four decades and a scatter beside them, the errors came out 2.6 times too small.
_FEWEST_FOR_OWN_WEIGHTS, _FEWEST_SOURCES = 40, 10


def _compute_weighted_normals(field, modes, edges, counts, method, value, rng):
    """Normal equations of each bin by the weights of a robust fit, whether χ² scales their errors, and a note.

    The fit is the bin's own: by that of all sources, those of a bin that differs would be outliers. A few sources
    cannot tell their weights.
    """
    if min(counts) < _FEWEST_SOURCES:
        raise DegeneracyError(
            f"a bin has {min(counts)} sources, and its errors need {_FEWEST_SOURCES}: take fewer bins, or least-squares"
        )
    has_own = min(counts) >= _FEWEST_FOR_OWN_WEIGHTS
    lmax = None if method == "recommended" else modes
    bin_fields = [apply_step(field, partial(_select_redshift_bin, low=low, high=high)) for low, high in pairwise(edges)]
    try:
        fits = [estimate(sources, lmax, method, value, rng=rng) for sources in (bin_fields if has_own else [field])]
    except DegeneracyError as error:
        raise DegeneracyError(f"{error}; or take fewer bins") from None
    if any(fit.weights is None for fit in fits):
        if method == "recommended":
            raise DegeneracyError("a robust fit does not settle: take fewer bins, or the method excess-noise")
        raise ParameterError(f"bins take least-squares, clip, recommended, student or excess-noise, not {method}")
    normals = [fits[i if has_own else 0].equations(sources, modes) for i, sources in enumerate(bin_fields)]
    remark = "each bin has the weights of its own fit" if has_own else "bins have the weights of the fit of all sources"
    return normals, all(fit.is_scaled for fit in fits), (f"{remark} ({method})",)


def _select_redshift_bin(field, low, high):
    """Select the sources of a bin of redshift."""
    if field.redshift is None:
        return with_redshift(field, 0.0)  # which says what is missing
    return field[usable_mask(field.redshift, 0.0) & (field.redshift >= low) & (field.redshift < high)]


def _sum_by_bin(field, edges, modes, calibration, flow, sum_normals):
    """Sum sources by bin: moments of the redshifts, normal equations, columns of the flow; and what was left out."""
    try:
        usable = with_redshift(field, 0.0)
    except EmptyFieldError as error:  # other parts may have some
        return {"notes": [(*field.notes, *error.notes)]}
    classes = Classes.by_edges("z", edges, usable.redshift, ends=False)
    sums: dict[Any, Any] = {"outside": len(usable) - sum(mask.sum() for _, mask in classes), "notes": [usable.notes]}
    for i, (_, mask) in enumerate(classes):
        if not mask.any():
            continue
        bin_field = usable[mask]
        rate = motions_per_velocity(bin_field, calibration)
        moments = _sum_redshift_moments(bin_field, rate)
        columns: tuple[Any, ...] = ()
        if flow is not None:
            bin_field, flow_columns = flow.make_flow_field_and_columns(bin_field, rate, modes)
            columns = (flow_columns,)
        sums[i] = (moments, sum_normals(bin_field, modes), *columns)
    return sums


def _explain_equal_edges(edges):
    """Explain why inner edges are not apart, and what helps."""
    if edges[-1] - edges[0] < 1e-9 * abs(edges[0]):
        return "all sources have one redshift"
    return "a few sources, or one redshift, weigh more than a bin: take fewer, or give their edges"


@arguments.accepts(field=arguments.a(Field, Parts), n_bins=arguments.whole)
def equal_information_edges(field: Field | Parts, n_bins: int) -> FloatArray:
    """Edges of redshift bins that hold the same weight of motions, (n_bins + 1,)."""
    sky = as_parts(field)
    n_sources, lowest, highest = sky.sum(_count_and_find_range, roles=("redshift",), words="redshifts")
    if n_sources < n_bins:
        raise DegeneracyError(f"{n_sources} sources do not fill {n_bins} bins")
    inner_edges = weighted_quantiles(
        sky,
        partial(_select_usable_column, column="redshift"),
        partial(_select_usable_column, column="information"),
        np.arange(1, n_bins) / n_bins,
        roles=("redshift",),
        words="bins of redshift",
    )
    edges = np.r_[min(lowest), inner_edges, np.nextafter(max(highest), np.inf)]
    if not (np.diff(edges) > 0).all():
        raise DegeneracyError(f"{n_bins} bins cannot hold equal information: {_explain_equal_edges(edges)}")
    return edges


def _select_usable_column(field, column):
    """Select a column of the sources with a redshift; nothing where there is none."""
    return getattr(_select_redshift_bin(field, 0.0, np.inf), column)


def _count_and_find_range(field):
    """Count the sources with a redshift, and find the least and the largest, in lists that add over parts."""
    redshifts = _select_usable_column(field, "redshift")
    return len(redshifts), [redshifts.min()] if redshifts.size else [], [redshifts.max()] if redshifts.size else []


def _sum_redshift_moments(field, rate):
    """Sum moments: number of sources, Σw, Σwz, and beyond the flow Σw/d and Σw."""
    weight, z = field.information / 2, field.redshift
    return np.array([len(field), weight.sum(), weight @ z, AU_PER_YEAR * (weight @ rate), weight[rate > 0].sum()])


def _solve_each_bin(normals, edges, flow_columns):
    """Solve each bin by itself: solutions, the covariance of their noise, which modes are free, what the flow adds."""
    solutions = [_solve_bin(normal, bin_index, edges) for bin_index, normal in enumerate(normals)]
    covariance, flow_covariance = block_diag(*(solution.covariance for solution in solutions)), None
    if flow_columns is not None:
        flow_response = [s.covariance @ x for s, x in zip(solutions, flow_columns, strict=True)]
        solutions = [_add_flow_errors(s, k) for s, k in zip(solutions, flow_response, strict=True)]
        joint_response = np.concatenate(flow_response)
        flow_covariance = joint_response @ joint_response.T
    return solutions, covariance, np.arange(len(normals[0].modes)), flow_covariance


def _add_flow_errors(solution, flow_response):
    """A solution whose errors include a flow that was not fitted."""
    return replace(
        solution,
        covariance=solution.covariance + flow_response @ flow_response.T,
        errors_from="the catalogue, and flows of galaxies",
        error_source=ErrorSource.FLOWS,
    )


def _compute_chi2(normal, values):
    """χ² of coefficients by normal equations."""
    return float(normal.chi2_null - 2 * values @ normal.rhs + values @ normal.matrix @ values)


def _solve_jointly(normals, edges, flow_columns):
    """Degree 1 in each bin, the rest in common: one system of normal equations."""
    modes, n_bins = normals[0].modes, len(normals)
    free_modes = np.array([i for i, mode in enumerate(modes) if mode.l == 1])
    common_modes = np.array([i for i, mode in enumerate(modes) if mode.l > 1])
    for b, normal in enumerate(normals):  # a bin that cannot bear its own degree 1 is named by the error
        free_normal = NormalEquations(
            as_modes(1), normal.matrix[np.ix_(free_modes, free_modes)], normal.rhs[free_modes], 0.0, normal.n_data
        )
        _solve_bin(free_normal, b, edges)
    size, common_slice = 6 * n_bins + len(common_modes), slice(6 * n_bins, None)
    matrix, rhs = np.zeros((size, size)), np.zeros(size)
    for b, normal in enumerate(normals):
        block = slice(6 * b, 6 * b + 6)
        matrix[block, block], rhs[block] = (normal.matrix[np.ix_(free_modes, free_modes)], normal.rhs[free_modes])
        matrix[block, common_slice] = normal.matrix[np.ix_(free_modes, common_modes)]
        matrix[common_slice, block] = matrix[block, common_slice].T
        matrix[common_slice, common_slice] += normal.matrix[np.ix_(common_modes, common_modes)]
        rhs[common_slice] += normal.rhs[common_modes]
    scale = 1 / np.sqrt(np.diag(matrix))
    scaled_matrix = matrix * np.outer(scale, scale)
    if np.linalg.eigvalsh(scaled_matrix)[0] < 1e-10:
        raise DegeneracyError(
            f"the bins together cannot separate {len(common_modes)} common and {6 * n_bins} free coefficients"
        )
    covariance = np.linalg.inv(scaled_matrix) * np.outer(scale, scale)
    theta, flow_response = covariance @ rhs, None
    if flow_columns is not None:
        common_columns = sum(x[common_modes] for x in flow_columns)
        flow_response = covariance @ np.concatenate([*(x[free_modes] for x in flow_columns), common_columns])
    solutions = []
    for b, normal in enumerate(normals):
        unknowns = np.empty(len(modes), int)
        unknowns[free_modes], unknowns[common_modes] = np.arange(6 * b, 6 * b + 6), np.arange(6 * n_bins, size)
        values = theta[unknowns]
        solution = Solution(
            coefficients=Coefficients(modes, values),
            covariance=covariance[np.ix_(unknowns, unknowns)],
            chi2=_compute_chi2(normal, values),
            n_data=normal.n_data,
            frame=normal.frame,
            notes=normal.notes,
            errors_from="the catalogue, all bins together",
        )
        solutions.append(solution if flow_response is None else _add_flow_errors(solution, flow_response[unknowns]))
    of_bins = None if flow_response is None else flow_response[: 6 * n_bins]
    noise, flow_covariance = (covariance[: 6 * n_bins, : 6 * n_bins], None if of_bins is None else of_bins @ of_bins.T)
    return solutions, noise, free_modes, flow_covariance


def _solve_bin(normal, number, edges):
    """Solve the equations of a bin; an error names it."""
    try:
        return solve(normal)
    except DegeneracyError as error:
        raise DegeneracyError(f"bin {number + 1}, {_label_bins(edges)[number]}: {error}; or take fewer bins") from None


def _label_bins(edges):
    return Classes.by_edges("z", edges, ends=False).labels


@arguments.accepts(
    field=arguments.a(Field), binned=arguments.a(BinnedSolution), n_permutations=arguments.whole, rng=arguments.seed
)
def permutation_test(
    field: Field,
    binned: BinnedSolution,
    *,
    n_permutations: int = 1000,
    rng: Rng = 1,
    velocity: Vector | None = None,
    redshift_frame: str | None = None,
    peculiar_dispersion: float | None = None,
) -> dict[str, float]:
    """p-values by permutation: how often permuted redshifts give bins that differ at least as much.

    Positions, motions and errors stay together; the redshifts are permuted. Before that, the errors of each
    source are multiplied by the √(χ²/dof) of its bin, and in every permutation those of each bin by its own:
    so the test holds where errors are wrong in a way that depends on redshift, as a permutation of
    statistics that are studentised does (Janssen 1997, Stat. Probab. Lett. 36, 9). For degree 1.

    Parameters
    ----------
    field : Field
        The field from which the bins were made.
    binned : BinnedSolution
        Bins fitted to degree 1.
    n_permutations : int
        How many.
    rng : Generator or int
        The source of all randomness.
    velocity : Vector, optional
        Ours [km/s]: tests "secular_parallax" as well, whether the bins contradict a constant
        acceleration with the secular parallax of that velocity.
    redshift_frame, peculiar_dispersion
        As for `fit.redshift.binned`: for the distances of the secular parallax.

    Returns
    -------
    dict of str to float
        "T" and "S": equality of spin and acceleration; "trend": no slope of both with redshift; "secular_parallax".

    Raises
    ------
    ParameterError
        If the bins are not of degree 1, or of galaxies near enough for coherent flows.

    Notes
    -----
    Permuting assumes that without a signal a source's motion has nothing to do with its redshift. It fails where the
    sky has degrees above 1 that are the same at all redshifts *and* redshifts depend on the place (two surveys of
    different depth): this field then leaks into the dipoles of the bins, depending on their place on the sky; bins with
    higher degrees in common (`binned(…, shared_higher_degrees=True)`) remove it. The test also fails for nearby
    galaxies, because neighbours have a common flow: for a true constant velocity p was 0.001 on every simulated sky.
    """
    if binned.modes.lmax != 1:
        raise ParameterError(f"permutations are for bins of degree 1, not {binned.modes.lmax}")
    if binned.flow_share > FLOW_MATTERS:
        raise ParameterError(
            "a permutation of the redshifts destroys the coherent flows of near galaxies, and every p-value is then "
            "too small. Quote the tests of the bins, which include the flows, or permute bins fitted with flows=None"
        )
    rng = generator(rng)
    field = with_redshift(field, 0.0)
    calibration = None if velocity is None else calibrate_if_known(field, redshift_frame, peculiar_dispersion)
    bin_index = np.searchsorted(binned.edges, np.asarray(field.redshift), side="right") - 1
    is_inside = (bin_index >= 0) & (bin_index < len(binned))
    field, bin_index = field[is_inside], bin_index[is_inside]
    motions = [field.motion]
    if velocity is not None:
        motions.append(field.motion - _compute_secular_parallax(field, velocity, calibration))
    basis_and_motions = np.concatenate([harmonics(field.lon, field.lat, Modes(1)), np.stack(motions)])
    # N, the right-hand sides, and χ² of nothing, of each source.
    products = np.einsum("ikn,jkn->nij", basis_and_motions, multiply_weights(field.weights, basis_and_motions))
    n_rows = products.shape[1]
    products = products.reshape(len(field), -1)
    # By the errors as they are quoted: bins that were fitted robustly have a scale of one, whatever their χ².
    sums, source_counts = _sum_products_by_bin(products, bin_index, len(binned), n_rows)
    products /= _compute_chi2_per_dof(sums, source_counts, 6)[bin_index, None]
    exceedances: dict[str, int] = {}
    observed: dict[str, float] = {}
    for _ in range(n_permutations + 1):
        sums, source_counts = _sum_products_by_bin(products, bin_index, len(binned), n_rows)
        statistics = _compute_test_statistics(sums, source_counts, binned, velocity is not None)
        if not observed:
            observed, exceedances = statistics, dict.fromkeys(statistics, 0)
        for name, chi2 in statistics.items():
            exceedances[name] += chi2 >= observed[name] * (1 - 1e-12)
        bin_index = rng.permutation(bin_index)
    return {name: count / (n_permutations + 1) for name, count in exceedances.items()}


def _compute_test_statistics(sums, source_counts, binned_solution, with_velocity):
    columns_by_kind = {kind: np.arange(6)[Modes(1).slice_of(kind, 1)] for kind in KINDS}
    values, covariance = _solve_scaled_bins(sums, source_counts, 6)
    statistics: dict[str, Any] = {
        kind: find_equality_chi2(values[:, at], covariance[:, at][:, :, at]) for kind, at in columns_by_kind.items()
    }
    if len(binned_solution) > 1:
        statistics["trend"] = find_slope_chi2(values, covariance, binned_solution.redshift)
    if with_velocity:
        values, covariance = _solve_scaled_bins(sums, source_counts, 7)
        at = columns_by_kind["S"]
        statistics["secular_parallax"] = find_equality_chi2(values[:, at], covariance[:, at][:, :, at])
    return statistics


def _sum_products_by_bin(products, bin_index, n_bins, size):
    """Sum the products of the sources of each bin, and count its sources."""
    sums = np.stack([np.bincount(bin_index, column, n_bins) for column in products.T], axis=1)
    return sums.reshape(-1, size, size), np.bincount(bin_index, minlength=n_bins)


def _solve_scaled_bins(sums, source_counts, motion_column):
    """Solve for the coefficients of each bin, and their covariance times the bin's χ²/dof."""
    inverse = np.linalg.inv(sums[:, :6, :6])
    values = np.einsum("bij,bj->bi", inverse, sums[:, :6, motion_column])
    return values, inverse * _compute_chi2_per_dof(sums, source_counts, motion_column)[:, None, None]


def _compute_chi2_per_dof(sums, source_counts, motion_column):
    """The χ²/dof of degree 1 in each bin; 1 where there are no degrees of freedom."""
    rhs = sums[:, :6, motion_column]
    fitted_chi2 = np.einsum("bi,bi->b", rhs, np.linalg.solve(sums[:, :6, :6], rhs[:, :, None])[:, :, 0])
    chi2, dof = sums[:, motion_column, motion_column] - fitted_chi2, 2 * source_counts - 6
    return np.where(dof > 0, chi2 / np.maximum(dof, 1), 1.0)


def _compute_secular_parallax(field, velocity, calibration):
    """The motions by our velocity, (2, n); none within the flow. [µas/yr]"""
    velocity = velocity_in_frame(velocity, field.frame).value
    p, q, _ = triad(field.lon, field.lat)
    return -np.stack([velocity @ p, velocity @ q]) * motions_per_velocity(field, calibration)
