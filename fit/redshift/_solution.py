"""Solutions in bins of redshift, the questions one asks of them, and coherent flows.

A flow moves whole neighbourhoods: it does not average out over the sources of a bin, and neighbouring bins share it. Of
every bin's normal equations N c = b it changes b by X a, with X = Σ Aᵀ W F over its sources, F the modes of a flow, and
a their amplitudes, one on average. The coefficients of all bins then have the covariance (N⁻¹X)(N⁻¹X)ᵀ more.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.special import chdtrc

from fit.background import ClassComparison, shared
from fit.distances import flow_information, flow_limits
from fit.results.output import format_amplitude
from fit.results.quality import Quality, f_p_value, gls
from fit.results.storage import Result
from fit.secular_parallax import LEFT_DISPERSION, make_flow_modes_within
from vsh.basis import harmonics
from vsh.classes import Classes
from vsh.coefficients import FIRST_DEGREE, solve_degree_one
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, as_parts
from vsh.io.sections import Section
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, FLAT_PLANCK13, FLOW_LIMIT, hubble_value, usable_mask
from vsh.models.flows import FlowModes, LinearTheory
from vsh.modes import KINDS, Modes
from vsh.tools.digits import format_p_value
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, Axes, AxesArray, FloatArray, Kind, OnAxes, Table
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector


class ChiSquare(NamedTuple):
    """A χ² with its degrees of freedom, and the probability of as much or more.

    `chi2` and `p_value` are with the errors of each bin multiplied by the root of its own χ²/dof, which makes them
    right whatever their scale is in each bin; `quoted` and `p_value_quoted` with the catalogue's errors as they are.
    Where errors are wrong by different factors within one bin, those of its faint sources for example, p-values may be
    too large (p < 0.05 on 1 % of simulated skies, not 5 %). Choose an edge of a bin where the errors change.
    """

    chi2: float
    dof: int
    p_value: float
    quoted: float = float("nan")
    p_value_quoted: float = float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class Trend(Result):
    """Coefficients that change linearly: c(x) = c_0 + slope (x − x_0).

    Attributes
    ----------
    slopes : (q,) array
        Slope of each coefficient that is free in every bin. [µas/yr per unit of x]
    covariance : (q, q) array
    test : ChiSquare
        Test of no slope.
    misfit : ChiSquare
        Misfit of the bins about the trend.
    spin, acceleration : Vector
        The slopes of degree 1 as vectors.
    """

    slopes: FloatArray
    covariance: FloatArray
    test: ChiSquare
    misfit: ChiSquare
    spin: Vector
    acceleration: Vector

    def _sections(self, long):
        test = self.test
        facts = [("no slope", f"χ² = {test.chi2:.2f} for {test.dof}, p = {format_p_value(test.p_value)}")]
        return (Section("Slopes of spin and acceleration with redshift", facts, self.to_table()),)

    def to_table(self) -> Table:
        """The slopes of spin and acceleration with their errors as an astropy Table."""
        names = [f"{name}_{axis}" for name in ("spin", "acceleration") for axis in "xyz"]
        spin, acceleration = self.spin, self.acceleration
        columns = {"parameter": names, "slope": np.concatenate([spin.value, acceleration.value])}
        return tables.table_of(columns | {"slope_error": np.concatenate([spin.sigma, acceleration.sigma])})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The slopes with their errors, on matplotlib axes."""
        from fit.redshift._plot import plot_trend

        return plot_trend(self, ax=ax)


def compute_welch_correction(binned: Any, n_contrasts: int) -> tuple[float, float]:
    """Divisor of a scaled χ², and the degrees of freedom of its scale (Welch 1951), for `steps` contrasts."""
    weight, dof = compute_weights_and_dof(binned)
    share = weight / weight.sum()
    welch_sum = np.sum((1 - share) ** 2 / dof)
    n_means = n_contrasts + 1
    return 1 + 2 * (n_means - 2) / (n_means * n_means - 1) * welch_sum, (n_means * n_means - 1) / (3 * welch_sum)


def compute_weights_and_dof(binned: Any) -> tuple[FloatArray, FloatArray]:
    """Weight of each bin with scaled errors, and the degrees of freedom of its scale."""
    weight = 1 / np.diag(binned.covariance).reshape(len(binned), -1).sum(1) / binned.scales
    return weight, np.array([max(s.dof, 1) for s in binned.solutions])


def find_estimated_slope_chi2(estimate: tuple[FloatArray, float, FloatArray], q: int) -> float:
    """χ² of no slope, from what `gls` found for constants and slopes."""
    theta, _, theta_covariance = estimate
    return float(theta[q:] @ np.linalg.solve(theta_covariance[q:, q:], theta[q:]))


def find_equality_chi2(values: FloatArray, covariance: FloatArray) -> float:
    """χ² of the differences of independent bins: values (B, q), covariance (B, q, q)."""
    weights = np.linalg.inv(covariance)
    weighted = np.einsum("bij,bj->bi", weights, values)
    return float(np.sum(values * weighted) - weighted.sum(0) @ np.linalg.solve(weights.sum(0), weighted.sum(0)))


def find_slope_chi2(values: FloatArray, covariance: FloatArray, x: FloatArray) -> float:
    """χ² that a straight line takes away from independent bins: that of no slope."""
    weights = np.linalg.inv(covariance)
    design = np.stack([np.ones_like(x), x - x.mean()])
    normal = np.einsum("kb,lb,bij->kilj", design, design, weights).reshape(2 * weights.shape[1], -1)
    rhs = np.einsum("kb,bij,bj->ki", design, weights, values)
    return float(rhs.ravel() @ np.linalg.solve(normal, rhs.ravel()) - rhs[0] @ np.linalg.solve(weights.sum(0), rhs[0]))


#: From this share in a variance on, a flow matters to the tests of bins.
FLOW_MATTERS = 0.05
_BLOCK_SIZE = 4096


@dataclass(frozen=True, eq=False)
class SharedFlow:
    """The modes of a flow over the distances of a catalogue, and what galaxies move beside it."""

    theory: LinearTheory
    modes: FlowModes
    dispersion: float

    @property
    def description(self) -> str:
        """Description for a report."""
        modes = f"{len(self.modes)} modes of {self.theory.name}"
        return f"{modes}, and an independent dispersion of {self.dispersion:g} km/s"

    def make_flow_field_and_columns(self, field: Field, rate: FloatArray, modes: Modes) -> tuple[Field, FloatArray]:
        """Make a field whose errors hold the sources' own motions, and X (p, m) of those within reach of the flow."""
        source_indices = np.flatnonzero(rate > 0)
        distance = hubble_value(FLAT_PLANCK13) / 100 / (AU_PER_YEAR * rate[source_indices])
        residual_variance = np.full(source_indices.size, self.theory.sigma**2)
        is_within_reach = distance <= self.modes.radii[-1]
        residual_variance[is_within_reach] = self.modes.left(distance[is_within_reach])[0]
        motion_variance = np.zeros(len(field))
        motion_variance[source_indices] = rate[source_indices] ** 2 * (residual_variance + self.dispersion**2)
        sigma = np.sqrt(field.sigma**2 + motion_variance)
        field = field.with_errors(sigma, field.rho * np.prod(field.sigma, 0) / np.prod(sigma, 0))
        source_indices, distance = source_indices[is_within_reach], distance[is_within_reach]
        flow_columns = np.zeros((len(modes), len(self.modes)))
        a, b, c = field.weights
        for start in range(0, source_indices.size, _BLOCK_SIZE):
            rows, block_distance = source_indices[start : start + _BLOCK_SIZE], distance[start : start + _BLOCK_SIZE]
            east, north = self.modes.at(field.lon[rows], field.lat[rows], block_distance)[0] * rate[rows, None]
            basis = harmonics(field.lon[rows], field.lat[rows], modes)
            flow_columns += (basis[:, 0] * a[rows] + basis[:, 1] * c[rows]) @ east
            flow_columns += (basis[:, 0] * c[rows] + basis[:, 1] * b[rows]) @ north
        return field, flow_columns


def _tabulate_flow(field, low, high):
    if field.redshift is None:
        return 0.0
    is_inside = usable_mask(field.redshift) & (field.redshift >= low) & (field.redshift < high)
    return flow_information(field.redshift[is_inside], field.information[is_inside]) if is_inside.any() else 0.0


def make_shared_flow(
    field: Any, edges: FloatArray, theory: LinearTheory, dispersion: float | None, n_modes: int
) -> SharedFlow | None:
    """The flow of the sources between some redshifts; None where they are all beyond its reach."""
    low, high = max(edges[0], FLOW_LIMIT), max(edges[-1], FLOW_LIMIT)
    if isinstance(field, Field | Parts):
        table = as_parts(field).sum(partial(_tabulate_flow, low=low, high=high), roles=("redshift",), words="redshifts")
        if np.any(table):
            low, high = flow_limits(table)
    modes = make_flow_modes_within((low, high), FLAT_PLANCK13, theory, n_modes)
    return None if modes is None else SharedFlow(theory, modes, LEFT_DISPERSION if dispersion is None else dispersion)


#: A p-value below this is called a difference; the Gaussian's three σ.
_REMARKABLE_P_VALUE = 0.0027
#: From so many sources on systematic errors over the sky matters beside their noise.
_MANY_SOURCES = 100_000


def _make_tests_section(binned_solution, velocity, p_values):
    """Section on whether the bins differ, each hypothesis with its p-values."""
    tests = {"T": ("spin alike in all bins", binned_solution.equality("T", 1))}
    tests["S"] = ("acceleration alike in all bins", binned_solution.equality("S", 1))
    if len(binned_solution) > 1:
        tests["trend"] = ("neither has a linear trend with redshift", binned_solution.trend(first=True).test)
    if velocity is not None and np.isfinite(binned_solution.mean_inverse_distance).all():
        hypothesis = f"constant acceleration plus secular parallax, |v| = {velocity.amplitude:.0f} km/s"
        tests["secular_parallax"] = (hypothesis, binned_solution.secular_parallax(velocity)[1])
    rows = []
    for name, (hypothesis, test) in tests.items():
        if test.dof:
            permuted_p = (p_values or {}).get(name, np.nan)
            verdict = "contradicted" if np.fmax(test.p_value, permuted_p) < _REMARKABLE_P_VALUE else "not contradicted"
            rows.append((hypothesis, test.quoted, test.dof, test.p_value_quoted, test.p_value, permuted_p, verdict))
    column_names = ("hypothesis", "χ²", "dof", "p_value formal", "p_value scaled", "p_value permuted", "verdict")
    remarks = [f"permuted: {reason}"] if (reason := _explain_no_permutation(binned_solution, p_values)) else []
    table, forms = tables.table_of_rows(column_names, rows), {"χ²": ".2f"}
    return Section("Do the bins differ?", (), table, forms=forms, remarks=remarks, notes=binned_solution.notes)


def _explain_no_permutation(binned_solution, p_values):
    """Reason why redshifts were not permuted; nothing where they were."""
    if p_values is not None or len(binned_solution) == 1:
        return ""
    if binned_solution.modes.lmax > 1:
        return "computed with --lmax 1 alone"
    if binned_solution.flow_share > FLOW_MATTERS:
        return "not computed, because a permutation of redshifts destroys the coherent flow of neighbouring galaxies"
    return "not computed here (fit.redshift.permutation_test does; vsh-redshift of up to 20000 sources without --floor)"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class BinnedSolution(Result):
    """Solutions in bins of redshift with their joint covariance.

    Attributes
    ----------
    edges : (B + 1,) array
    solutions : list of B Solutions
        With `shared_higher_degrees` they share what is above degree 1.
    normals : list of B NormalEquations
        Their sum is that of all the sources.
    redshift : (B,) array
        Mean, weighted by information.
    counts : (B,) int array
        Sources.
    covariance : (B q, B q) array
        Covariance of the noise of the q coefficients that are free in every bin, bin by bin.
    free : (q,) int array
        Their places among the modes.
    mean_inverse_distance : (B,) array
        Mean of 1/d_M of the sources beyond the flow, weighted by information; nan where there is none. [1/Mpc]
    notes : tuple of str
    flow_covariance : (B q, B q) array or None
        Contribution of coherent flows to the covariance; None without flows. The errors of the `solutions` include it.
    flow : str
        The flow in words.
    is_scaled : bool
        Whether tests multiply the errors of each bin by its √(χ²/dof): not where they come from residuals already.
    """

    edges: FloatArray
    solutions: list
    normals: list
    redshift: FloatArray
    counts: FloatArray
    covariance: FloatArray
    free: FloatArray
    mean_inverse_distance: FloatArray
    notes: tuple[str, ...]
    flow_covariance: FloatArray | None = None
    flow: str = ""
    is_scaled: bool = True

    def __len__(self) -> int:
        return len(self.solutions)

    def __repr__(self) -> str:
        return f"<BinnedSolution: {len(self)} bins, {self.counts.sum()} sources, degree {self.modes.lmax}>"

    @property
    def modes(self) -> Modes:
        """The Modes that were fitted."""
        return self.solutions[0].modes

    @property
    def frame(self) -> str:
        """Frame of the axes."""
        return self.solutions[0].frame

    @property
    def quality(self) -> Quality:
        """Quality of all bins together by χ², a `fit.quality.Quality`."""
        return Quality(sum(s.chi2 for s in self.solutions), sum(s.dof for s in self.solutions))

    @property
    def reduced_chi2(self) -> float:
        """χ² per degree of freedom, over all bins."""
        return self.quality.reduced

    @property
    def effective_redshift(self) -> FloatArray:
        """The redshift whose 1/d_M is the bin's mean, (B,); the mean redshift where there is no distance."""
        from vsh.models.cosmology import compute_redshift

        return np.where(
            np.isfinite(self.mean_inverse_distance), compute_redshift(1 / self.mean_inverse_distance), self.redshift
        )

    @property
    def scales(self) -> FloatArray:
        """χ² per degree of freedom of each bin, (B,): what variances are multiplied with in tests.

        1 for a bin without degrees of freedom, and where errors come from residuals already.
        """
        if not self.is_scaled:
            return np.ones(len(self))
        return np.array([s.reduced_chi2 if s.dof > 0 and s.chi2 > 0 else 1.0 for s in self.solutions])

    @property
    def flow_share(self) -> float:
        """The largest share of flows in the variance of any combination of the bins' coefficients; 0 without flows."""
        if self.flow_covariance is None:
            return 0.0
        variance_ratio = float(eigh(self.flow_covariance, self.covariance, eigvals_only=True)[-1])
        return variance_ratio / (1 + variance_ratio)

    def equality(self, kind: Kind | None = None, l: int | None = None) -> ChiSquare:
        """Are all bins alike? χ² of their differences, with the full covariance.

        Parameters
        ----------
        kind : {"T", "S"}, optional
            Only these coefficients; both unless given.
        l : int, optional
            Only this degree; all that is free unless given.

        Returns
        -------
        ChiSquare
            Valid if the errors of each bin are wrong by any one factor, with at least 20 sources a bin, and for nearby
            galaxies with flows of linear theory. Not valid if sources have other errors in common over the sky (with
            Gaia's, p < 0.05 in 11 to 14 % of skies at degrees 1 and 3; at degree 7 in 3 to 7 % where the bins cover the
            same sky, in 67 to 98 % where they do not), nor where the sky has degrees that were not fitted and the bins
            cover different parts of the sky.

        Notes
        -----
        Scales estimated from few sources are allowed for as in Welch's (1951, Biometrika 38, 330) test of
        means with unequal variances.
        """
        return self._test_about_design(kind, l, np.ones((len(self), 1)))[0]

    def trend(self, x: ArrayLike | None = None, *, first: bool = False) -> Trend:
        """Fit a straight line in x to the coefficients of the bins, and test its slope.

        Parameters
        ----------
        x : (B,) array, optional
            The bins' redshifts unless given; `mean_inverse_distance` makes it a secular parallax.
        first : bool
            Degree 1 alone, in place of all coefficients that are free in every bin.

        Raises
        ------
        ParameterError
            If x is not one finite number for each bin, or there are fewer than two bins.
        """
        x = self.redshift if x is None else np.asarray(x, float)
        if x.shape != (len(self),) or not np.isfinite(x).all():
            raise ParameterError(f"a trend needs a finite x for each of the {len(self)} bins")
        if len(self) < 2 or np.ptp(x) == 0:
            raise ParameterError("a trend needs at least two bins")
        design = np.stack([np.ones(len(self)), x - x.mean()], 1)
        misfit, scaled, quoted, free_modes = self._test_about_design(None, 1 if first else None, design)
        q = len(free_modes)
        slopes, matrix = quoted[0][q:], quoted[2][q:, q:]
        spin, acceleration = (_make_vector(self.modes, kind, slopes, matrix, free_modes, self.frame) for kind in KINDS)
        chi2_pair = find_estimated_slope_chi2(scaled, q), find_estimated_slope_chi2(quoted, q)
        # Satterthwaite's (1946) degrees of freedom of a slope's scale, from each bin's share in its variance.
        weight, dof = compute_weights_and_dof(self)
        shares = weight * (x - weight @ x / weight.sum()) ** 2
        p_value = f_p_value(chi2_pair[0], q, shares.sum() ** 2 / np.sum(shares**2 / dof))
        test = ChiSquare(chi2_pair[0], q, p_value, chi2_pair[1], float(chdtrc(q, chi2_pair[1])))
        return Trend(slopes=slopes, covariance=matrix, test=test, misfit=misfit, spin=spin, acceleration=acceleration)

    def secular_parallax(self, velocity: Vector) -> tuple[Vector, ChiSquare]:
        """The acceleration that, with the secular parallax of a known velocity, fits the bins best.

        Parameters
        ----------
        velocity : Vector
            Our velocity, toward the apex, for the distances in `mean_inverse_distance`. [km/s]

        Returns
        -------
        acceleration : Vector
        test : ChiSquare
            Test of the bins about that prediction.

        Raises
        ------
        ParameterError
            If a bin has no distance.
        """
        if not np.isfinite(self.mean_inverse_distance).all():
            raise ParameterError("a secular parallax needs a distance in every bin: some have no source with z ≥ 1e-4")
        parallax_per_inverse_distance = FIRST_DEGREE @ -velocity.to_frame(self.frame).value / AU_PER_YEAR
        parallaxes = np.outer(self.mean_inverse_distance, parallax_per_inverse_distance)
        test, _, (theta, _, matrix), free_modes = self._test_about_design("S", 1, np.ones((len(self), 1)), parallaxes)
        return _make_vector(self.modes, "S", theta, matrix, free_modes, self.frame), test

    def vectors(self, name: Literal["spin", "acceleration"]) -> list[Vector]:
        """The spin or the acceleration of each bin, with the errors that are printed.

        Parameters
        ----------
        name : {"spin", "acceleration"}
            Which vector. For least squares without flows, errors are multiplied by √(χ²/dof) if χ² contradicts them.
        """
        is_scaled = self.is_scaled and self.flow_covariance is None
        return [getattr(solution.scaled if is_scaled else solution, name) for solution in self.solutions]

    def to_table(self) -> Table:
        """Spin and acceleration in each bin, with errors, as an astropy Table."""
        columns = {
            "z_low": self.edges[:-1],
            "z_high": self.edges[1:],
            "z": self.redshift,
            "sources": self.counts,
            "chi2_dof": np.array([s.reduced_chi2 for s in self.solutions]),
        }
        for name in ("spin", "acceleration"):
            vectors = self.vectors(name)
            for i, axis in enumerate("xyz"):
                columns[f"{name}_{axis}"] = np.array([v.value[i] for v in vectors])
                columns[f"{name}_{axis}_error"] = np.array([v.sigma[i] for v in vectors])
        units = {name: "uas / yr" for name in columns if name.startswith(("spin", "acceleration"))}
        return tables.table_of(columns, {"frame": self.frame, "notes": list(self.notes)}, units)

    def sections(
        self,
        *,
        long: bool = False,
        velocity: Vector | None = CMB_VELOCITY_PLANCK18,
        p_values: Mapping[str, float] | None = None,
    ) -> tuple[Section, ...]:
        """The bins, and whether they differ.

        Parameters
        ----------
        long : bool
            Give the components of each bin in place of the amplitudes.
        velocity : Vector, optional
            Our velocity, to test the secular parallax. [km/s]
        p_values : dict of str to float, optional
            Those of `permutation_test`.

        Notes
        -----
        Every hypothesis is tested three ways: with formal errors, with the errors of each bin multiplied by the root
        of its own χ²/dof, and by permuting redshifts. It is called contradicted where both of the last two say so (the
        second alone where there are no permutations).
        """
        warnings = [
            f"warning: bin {b + 1}: {solution.quality.warning()}"
            for b, solution in enumerate(self.solutions)
            if self.is_scaled and solution.quality.warning()  # errors are of the residuals already otherwise
        ]
        if self.is_scaled and self.counts.min() < 20:
            warnings.append("warning: a bin has fewer than 20 sources, too few to tell the scale of its errors")
        if self.counts.sum() >= _MANY_SOURCES and self.modes.lmax < 7:
            warnings.append(
                "warning: systematic errors, as those of Gaia, are not in the p-values: with them p < 0.05 on 11 to "
                "14 % of skies at degrees 1 to 3. --lmax 7 (degree 7) gives 3 to 7 % where the bins cover the same "
                "sky; where they cover different skies it does not help"
            )
        if self.flow_share > 0.01:
            warnings.append(f"Errors and p-values contain coherent flows: {self.flow}")
        title = f"Bins of redshift ({self.frame} axes, degree 1 to {self.modes.lmax})"
        table = self.to_table()
        if not long:
            for name in ("spin", "acceleration"):
                table[f"|{name}| [µas/yr]"] = [format_amplitude(vector) for vector in self.vectors(name)]
        columns = [name for name in table.colnames if long or not name.startswith(("spin", "acceleration"))]
        bins_section = Section(title, (), table, columns, forms={"chi2_dof": ".2f"}, remarks=warnings)
        return (bins_section, _make_tests_section(self, velocity, p_values))

    def shared(self, degrees: Iterable[int] | None = None, **options: Any) -> ClassComparison:
        """Spin and acceleration of the bins with common systematic errors, from the power of their higher degrees.

        Parameters
        ----------
        degrees : iterable of int, optional
            From 2 on; to the highest that was fitted unless given.
        **options
            As for `fit.background.shared`: shapes, own, draws, noise_scale, rng.

        Raises
        ------
        ModesError
            If the bins were fitted to less than degree 3.

        Notes
        -----
        For nearby galaxies the covariance of coherent flows is added to that of the systematic errors.
        """
        labels = Classes.by_edges("z", self.edges, ends=False).labels
        options = {"noise_scale": self.is_scaled} | options
        comparison = replace(shared(self.normals, degrees, labels=labels, **options), made_by="redshift")
        if self.flow_covariance is None:
            return comparison
        modes, bins, q = list(self.modes), len(self), len(self.free)
        dipole_indices = [i for i, k in enumerate(self.free) if modes[k].l == 1]
        index = (np.arange(bins)[:, None] * q + dipole_indices).ravel()
        flow = self.flow_covariance[np.ix_(index, index)].reshape(bins, len(dipole_indices), bins, len(dipole_indices))
        return replace(
            comparison,
            covariances=comparison.covariances + flow,
            notes=(*comparison.notes, "flows are in these errors"),
        )

    def plot(self, velocity: str | Vector | None = "planck", *, ax: OnAxes | None = None) -> AxesArray:
        """Components against redshift, with the secular parallax of a velocity drawn in; on matplotlib axes.

        Parameters
        ----------
        velocity : "planck", Vector or None
            Our velocity, whose secular parallax is drawn in.
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.redshift._plot import plot_bins

        return plot_bins(self, velocity, ax=ax)

    def _select_free_coefficients(self, kind, l):
        """Select (B, q) of the free coefficients, their covariance, which they are, and what of it is noise."""
        modes = list(self.modes)
        free_indices = [i for i, k in enumerate(self.free) if kind in (None, modes[k].kind) and l in (None, modes[k].l)]
        if not free_indices:
            raise ParameterError(f"no free coefficients of kind {kind} and degree {l} in the bins")
        free_modes = self.free[free_indices]
        q, bins = len(self.free), len(self)
        indices = (np.arange(bins)[:, None] * q + free_indices).ravel()
        values = np.stack([solution.coefficients.values[free_modes] for solution in self.solutions])
        noise = self.covariance[np.ix_(indices, indices)]
        total = noise if self.flow_covariance is None else noise + self.flow_covariance[np.ix_(indices, indices)]
        return values, total, free_modes, noise

    def _test_about_design(self, kind, l, design, model=0.0):
        """Test the bins about a linear design; what the fit gave, scaled and as quoted: (θ, χ², errors); of which.

        The last are the modes of the coefficients.
        """
        values, covariance, free_modes, noise = self._select_free_coefficients(kind, l)
        q = values.shape[1]
        root_scales = np.repeat(np.sqrt(self.scales), q)
        scaled_estimate = gls(values - model, noise * np.outer(root_scales, root_scales) + (covariance - noise), design)
        quoted_estimate = gls(values - model, covariance, design)
        n_contrasts, test = len(self) - design.shape[1], ChiSquare(0.0, 0, float("nan"), 0.0, float("nan"))
        if dof := n_contrasts * q:
            factor, denominator = compute_welch_correction(self, n_contrasts)
            chi2, quoted = scaled_estimate[1] / factor, quoted_estimate[1]
            test = ChiSquare(chi2, dof, f_p_value(chi2, dof, denominator), quoted, float(chdtrc(dof, quoted)))
        return test, scaled_estimate, quoted_estimate, free_modes


def _make_vector(modes, kind, values, covariance, free_modes, frame):
    """A vector from those of the values that belong to degree 1 of a kind."""
    indices = np.searchsorted(free_modes, np.arange(len(modes))[modes.slice_of(kind, 1)])
    return solve_degree_one(FIRST_DEGREE, values[indices], covariance[np.ix_(indices, indices)], frame, "µas/yr")
