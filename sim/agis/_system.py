"""The joint solution: the normal equations of sources and attitude, the attitude eliminated; start, iterations, end.

An observation of source i at time t, under the position angle ψ, is

    along = m·δu − n·ε(t),   across = n·δu + m·ε(t),   m = p sin ψ + q cos ψ,   n = −p cos ψ + q sin ψ,

with δu = p (Δα* + µ_α* t) + q (Δδ + µ_δ t) + ϖ f and the attitude's error ε(t) a spline along the axes of the sky
(Lindegren et al. 2012, A&A 538, A78, linearised). The normal equations [S C; Cᵀ A] have blocks of five rows for each
source in S, and a band of twelve in A. A is factored once; what is left for the sources is (S − C A⁻¹ Cᵀ) x = g_s − C
A⁻¹ g_a.
"""

import re
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from sim.agis._calibration import AngleBlock, Calibration
from sim.agis._globals import GlobalMotion, MotionFit, find_sources_at, fit_low_degrees, make_source_slices
from sim.agis._results import AgisSolution
from sim.agis.passes import Scans, add_smoothing, check_memory, make_passes, system_memory
from sim.astrometry import LEAST_EIGENVALUE, smallest_eigenvalue
from sim.variability import Variability, chain_products
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import CheckpointError, ConvergenceError, DegeneracyError, ParameterError, VshWarning
from vsh.tools.files import digest_values, read_arrays, write_arrays
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import limit_blas, progress_bar
from vsh.tools.types import ArrayLike, FloatArray, PathName
from vsh.tools.units import JULIAN_YEAR


class Equations(InNotebook):
    """S, A factored, and what both do to vectors; those of sources are (n, 5, K)."""

    def __init__(
        self,
        scans: Scans,
        prior: float | None = None,
        *,
        smoothing: float = 1e6,
        motion: GlobalMotion | None = None,
        threads: int | None = None,
        compiled: bool | None = None,
        calibration: Calibration | str | None = None,
    ) -> None:
        arguments.a(Scans)("scans", scans)
        if motion is not None:
            arguments.a(GlobalMotion)("motion", motion)
        prior = None if prior is None else arguments.positive("prior", prior)
        if arguments.positive("smoothing", smoothing) < SMOOTHING_LIMIT:
            warnings.warn(
                f"smoothing of {smoothing:g} µas is a statement on the attitude: errors are right only where its "
                f"coefficients really bend no more; {SMOOTHING_LIMIT:g} and more bridge gaps alone",
                VshWarning,
                stacklevel=2,
            )
        angle_calibration = Calibration.parse(calibration)
        self.scans, self.prior, self.smoothing, self.motion = scans, prior, float(smoothing), motion
        self.coefficients = scans.intervals + 3
        self._check_across_scan_data()
        check_memory(
            system_memory(scans.n_sources, self.coefficients, scans.folder is not None),
            "the normal equations",
            "take fewer sources, or knots farther apart, or give scans a folder",
        )
        self.passes, blocks, band, self.solved = self._assemble_normal_equations(threads, compiled)
        self._check_redundancy()
        blocks[~self.solved] = np.eye(5)
        self.formal = np.linalg.inv(blocks)
        self.blocks = blocks
        if motion is not None:
            motion.check(scans.n_sources, self.solved)
            if not self.solved.all():  # sources without a solution tell nothing, not a motion of zero
                motion = self.motion = replace(motion, weights=np.where(self.solved, motion.weights, 0.0))
            self._constrained_blocks = blocks.copy()
            self._constrained_blocks[:, [3, 4], [3, 4]] += motion.weights[:, None]
            self.start = np.linalg.inv(self._constrained_blocks)
            self._reduced_normal = motion.reduced(self.formal)
        else:
            self._constrained_blocks, self.start = blocks, self.formal
        add_smoothing(band, 1 / smoothing**2)
        if prior is not None:
            band[0] += 1 / prior**2
        self.factor = self._factorise_attitude(band)
        self.angle = None if angle_calibration is None else AngleBlock(self, angle_calibration)

    def apply(self, x: FloatArray) -> FloatArray:
        """(S − C A⁻¹ Cᵀ) x, with what holds global motions; the basic angle eliminated like the attitude."""
        if x.ndim == 2:
            return self.apply(x[..., None])[..., 0]
        attitude = self.attitude_of(self.passes.to_attitude(x))
        product = self._constrained_blocks @ x - self.passes.to_sources(attitude)
        if self.angle is not None:
            product -= self.angle.compute_absorbed_part(x, attitude)
        if self.motion is not None:
            product[:, 3:] -= self.motion.pull(x)
        return product

    def attitude_of(self, rhs: FloatArray) -> FloatArray:
        """A⁻¹ of a right-hand side (coefficients, 3[, K])."""
        # A copy, which is overwritten: for one right-hand side the order of its axes is the same.
        flat_rhs = np.array(rhs.reshape(3 * self.coefficients, -1), order="F")
        return cho_solve_banded((self.factor, True), flat_rhs, overwrite_b=True, check_finite=False).reshape(rhs.shape)

    def reduce(self, source_rhs: FloatArray, attitude_rhs: FloatArray, along: FloatArray | None = None) -> FloatArray:
        """g_s − C A⁻¹ g_a, (n, 5), less what the basic angle takes, if it is solved for, of `along` behind both."""
        attitude = self.attitude_of(attitude_rhs)
        rhs = source_rhs - self.passes.to_sources(attitude[..., None])[..., 0]
        if self.angle is not None:
            assert along is not None
            rhs -= self.angle.compute_effects(self.angle_of(along, np.zeros_like(source_rhs), attitude))[1]
        return rhs

    def angle_of(self, along: FloatArray, sources: FloatArray, attitude: FloatArray) -> FloatArray:
        """Coefficients of the basic angle that fit observations less sources and attitude best."""
        assert self.angle is not None
        return self.angle.fit_coefficients(along - self.passes.predict(sources, attitude)[0])

    def precondition(self, r: FloatArray) -> FloatArray:
        """Solve each source by itself, with the constraints on global motions."""
        z = self.start @ r
        if self.motion is not None:
            design, weights = self.motion.design, self.motion.weights
            y = np.linalg.solve(self._reduced_normal, np.einsum("nik,n,nir->kr", design, weights, z[:, 3:]))
            z += self.start[:, :, 3:] @ np.einsum("n,nik,kr->nir", weights, design, y)
        return z

    def null_space(self) -> FloatArray:
        """The six motions that no observation sees, (6, n, 5): ε₀ along x, y, z, then ω."""
        return _make_rotation_basis(self.scans.sines_and_cosines)

    @property
    def defect(self) -> int:
        """Number of motions of `null_space` that no observation sees: six, three where motions are held, or none."""
        if self.prior is not None:
            return 0
        return 6 if self.motion is None or self.motion.spins else 3

    def without_null_space(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters less the rotation that fits them best, the blocks S as weights; and that rotation."""
        if not self.defect:
            return x, np.zeros((0, x.shape[-1]))
        rotation, remainder = self._fit_rotation(x, weighted=True), np.empty_like(x)
        for chunk, basis, _ in self._iterate_rotation_bases():
            remainder[chunk] = x[chunk] - np.einsum("kr,kni->nir", rotation, basis)
        return remainder, rotation

    def _fit_rotation(self, x, *, weighted):
        """The rotation in parameters, which the blocks S weight; or in functionals of them, unweighted."""
        normal, products = np.zeros((self.defect, self.defect)), np.zeros((self.defect, x.shape[-1]))
        for chunk, basis, weighted_basis in self._iterate_rotation_bases():
            normal += np.einsum("kni,lni->kl", weighted_basis, basis)
            products += np.einsum("kni,nir->kr", weighted_basis if weighted else basis, x[chunk])
        return np.asarray(np.linalg.solve(normal, products), float)

    def _iterate_rotation_bases(self):
        """Some sources at a time: which, the null space of those that are solved, and that times the blocks S."""
        sines_and_cosines = self.scans.sines_and_cosines
        for chunk in make_source_slices(len(self.blocks)):
            basis = _make_rotation_basis(sines_and_cosines[:, chunk])[: self.defect]
            basis[:, ~self.solved[chunk]] = 0
            yield chunk, basis, np.einsum("nij,knj->kni", self.blocks[chunk], basis)

    def _check_across_scan_data(self):
        scans = self.scans
        if self.prior is None and not (scans.weights[1] > 0).any():
            raise DegeneracyError(
                "no across-scan data: along the scan alone coefficient 0 of the attitude, and every other, is "
                "determined about one axis of three. Give sigma_across, or a prior, to which the attitude is known "
                "from elsewhere"
            )

    def _check_redundancy(self):
        """Raise DegeneracyError if the solved sources have fewer observations than there are unknowns."""
        scans, n = self.scans, int(self.solved.sum())
        n_observed = np.sum((scans.counts * (1 + (scans.weights[1] > 0)))[self.solved])
        surplus, n_unknowns = n_observed - 5 * n, 3 * self.coefficients
        if self.prior is None and surplus < n_unknowns:
            longer_knots = f"knots of {3 * scans.years * JULIAN_YEAR / surplus:.0f} s or more, " if surplus > 0 else ""
            raise DegeneracyError(
                f"too few sources for the knots: {n_observed:.0f} observations of {n} sources for {5 * n + n_unknowns} "
                f"unknowns ({scans.intervals} intervals). Take {longer_knots}more sources, sim.agis.scaled, or a prior"
            )

    def _assemble_normal_equations(self, threads, compiled):
        """Passes, blocks and band of the sources that have transits enough."""
        scans = self.scans
        is_solved = scans.counts > 5
        passes = make_passes(scans, is_solved, threads, compiled)
        blocks, band = passes.blocks()
        eigenvalues = [smallest_eigenvalue(blocks[chunk]) for chunk in make_source_slices(len(blocks))]
        is_determined = np.concatenate(eigenvalues) > LEAST_EIGENVALUE
        if (is_solved & ~is_determined).any():
            is_solved &= is_determined
            passes = make_passes(scans, is_solved, threads, compiled)
            blocks, band = passes.blocks()
        if not is_solved.any():
            raise DegeneracyError(
                f"none of {scans.n_sources} sources has transits enough for five parameters in {scans.years:g} years"
            )
        return passes, blocks, band, is_solved

    def _factorise_attitude(self, band):
        try:
            return cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        except LinAlgError as error:
            match = re.search(r"\d+", str(error))
            coefficient = (int(match[0]) - 1) // 3 if match else 0
            day = coefficient * self.scans.spacing * 365.25
            raise DegeneracyError(
                f"the attitude is not determined at its coefficient {coefficient} of {self.coefficients} (day "
                f"{day:.2f}): lower the smoothing, take more sources, or a prior"
            ) from None


def _make_rotation_basis(sines_and_cosines):
    """Rotations ε₀ and ω about x, y and z as parameters of the sources in some directions, (6, n, 5)."""
    # The directions are those that the observations have, in single precision.
    sa, ca, sd, cd = sines_and_cosines.astype(float)
    p, q = np.stack([-sa, ca, np.zeros_like(sa)]), np.stack([-sd * ca, -sd * sa, cd])
    basis = np.zeros((6, len(sa), 5))
    # ε × r has the components ε·q east and −ε·p north.
    basis[:3, :, 0], basis[:3, :, 1] = q, -p
    basis[3:, :, 3], basis[3:, :, 4] = q, -p
    return basis


#: Functionals solved for together.
BLOCK_FUNCTIONALS = 3
#: Iterations over which the sum of the variances must have come to rest.
_REST = 10


class ExactErrors(Equations):
    """Equations that tell the errors of what is made of their solution."""

    def formal_covariance(
        self, modes: Modes | int, lon: ArrayLike | None = None, lat: ArrayLike | None = None
    ) -> FloatArray:
        """Covariance of a fit to the motions as it would be quoted: each source alone, the attitude known."""
        return MotionFit(self, as_modes(modes), find_sources_at(self.scans, lon, lat)).formal

    def true_covariance(
        self,
        modes: Modes | int,
        lon: ArrayLike | None = None,
        lat: ArrayLike | None = None,
        *,
        variability: Variability | None = None,
        tolerance: float = 1e-3,
        iterations: int = 2000,
    ) -> FloatArray:
        """Covariance that the same fit really has, with all that sources share through the attitude; exact."""
        motion_fit = MotionFit(self, as_modes(modes), find_sources_at(self.scans, lon, lat))
        g = motion_fit.functionals(np.arange(len(motion_fit.modes)))
        return self._compute_covariance(g, tolerance, iterations, variability)

    def covariance_of(
        self,
        functionals: ArrayLike,
        *,
        variability: Variability | None = None,
        tolerance: float = 1e-3,
        iterations: int = 2000,
    ) -> FloatArray:
        """Covariance of any linear functionals Σ g x of the sources' parameters."""
        g = arguments.float_array("functionals", functionals)
        if g.ndim != 3 or g.shape[:2] != (self.scans.n_sources, 5):
            raise ParameterError(f"functionals have the shape ({self.scans.n_sources}, 5, K), not {g.shape}")
        return self._compute_covariance(g, tolerance, iterations, variability)

    def global_covariances(self, *, tolerance: float = 1e-3, iterations: int = 2000) -> tuple[FloatArray, FloatArray]:
        """Covariances of the global parameters: as sources that know the attitude would give them, and as they are."""
        if self.motion is None:
            raise ParameterError("there are no global parameters: give System a motion")
        g = np.stack([self.motion.functional(k) for k in range(len(self.motion.names))], axis=-1)
        true = self._compute_covariance(g, tolerance, iterations)
        # What the sources' own motions leave of y: the mean of Gy + own is no y.
        return np.asarray(np.linalg.inv(self._reduced_normal), float), true + np.linalg.inv(self.motion.normal)

    def _compute_covariance(self, functionals, tolerance, iterations, variability=None):
        """gᵀ N⁺ g of each pair of functionals (n, 5, K), what the null space does to them left out."""
        rhs = self._remove_null_space(functionals)
        solutions = np.empty_like(rhs)
        with limit_blas(0):
            for start in range(0, rhs.shape[-1], BLOCK_FUNCTIONALS):
                columns = slice(start, start + BLOCK_FUNCTIONALS)
                rhs_chunk = np.ascontiguousarray(rhs[..., columns])
                solutions[..., columns] = _solve_until_variances_rest(self, rhs_chunk, tolerance, iterations)
        k = rhs.shape[-1]
        covariance = rhs.reshape(-1, k).T @ solutions.reshape(-1, k)
        if variability is not None and variability.sigma > 0:
            covariance += self._compute_variability_covariance(solutions, variability)
        return (covariance + covariance.T) / 2

    def _remove_null_space(self, functionals):
        """Functionals of parameters from which the null space is taken out, by the blocks as weights."""
        projected_functionals = functionals.copy()
        projected_functionals[~self.solved] = 0
        if self.defect:
            rotation = self._fit_rotation(projected_functionals, weighted=False)
            for chunk, _, weighted_basis in self._iterate_rotation_bases():
                projected_functionals[chunk] -= np.einsum("kr,kni->nir", rotation, weighted_basis)
        return projected_functionals

    def _compute_variability_covariance(self, solutions, variability):
        """Contribution of varying photocentres: Σ over sources of aᵀ C a, a the weight of each observation in a
        functional."""
        scans = self.scans
        time_order = np.argsort(scans.source, kind="stable")  # of a source, in the order of time
        source, time = scans.source[time_order], scans.time()[time_order]
        weights = scans.weights[:, source] * self.solved[source]
        sin, cos = (column[time_order].astype(float) for column in (scans.sin, scans.cos))
        functional_weights = []
        for x in np.moveaxis(solutions, -1, 0):
            x = np.ascontiguousarray(x)
            attitude = self.attitude_of(-self.passes.to_attitude(x[..., None])[..., 0])
            predictions = self.passes.predict(x, attitude)
            if self.angle is not None:
                shifts, _, attitude_change = self.angle.compute_effects(self.angle.fit_coefficients(predictions[0]))
                attitude_shifts = self.passes.predict(np.zeros_like(x), attitude_change)
                predictions = predictions[0] - shifts + attitude_shifts[0], predictions[1] + attitude_shifts[1]
            along, across = (w * prediction[time_order] for w, prediction in zip(weights, predictions, strict=True))
            functional_weights += [np.stack([along * sin - across * cos, along * cos + across * sin])]
        products = chain_products(np.array(functional_weights), source, time, variability.tau)
        return variability.sigma**2 * products


def _solve_until_variances_rest(equations, rhs, tolerance, iterations):
    iteration = Iteration(equations, rhs)
    total_gain, gains = np.zeros(rhs.shape[-1]), []
    for _ in range(iterations):
        iteration.step()
        gains.append(iteration.gain)
        total_gain += iteration.gain
        growth = np.sum(gains[-_REST:], axis=0) / np.where(total_gain > 0, total_gain, 1.0)
        if (len(gains) >= _REST and growth.max() < tolerance) or iteration.residual < 1e-12:
            return iteration.x
    raise ConvergenceError(
        f"variances still grew by {100 * growth.max():.2g} % in the last {_REST} of {iterations} iterations; standard "
        f"errors are at least {', '.join(f'{x:.4g}' for x in np.sqrt(total_gain))}. Allow more iterations, or a larger "
        "tolerance"
    )


#: Second differences smaller than this are a statement on the attitude, not a bridge over gaps. [µas]
SMOOTHING_LIMIT = 1e4


class System(ExactErrors):
    """The normal equations of sources and attitude, ready to be solved.

    Parameters
    ----------
    scans : Scans
        The transits.
    prior : float, optional
        Coefficients of the attitude are known from elsewhere to so many µas; not at all unless given.
    smoothing : float
        Second differences of the attitude's coefficients are taken to vanish to so many µas: it bridges gaps. Below 1e4
        it is a statement on the attitude, and warned of.
    motion : GlobalMotion, optional
        A field that motions follow, solved for as well.
    threads : int, optional
        One a core unless given; changes no bit of a result.
    compiled : bool, optional
        By numba, or without (for some million transits at most); by numba where it is installed and
        they are many.
    calibration : Calibration or str, optional
        What is solved for of the basic angle as well, as "free every 5 days to order 1"; nothing unless given. It takes
        three times as long.

    Raises
    ------
    DegeneracyError
        If nothing is measured across the scan and there is no prior, if there are more unknowns than observations, if
        no source has transits enough; or if a coefficient of the attitude is not determined, which the message names.
    ParameterError
        If a number is not above zero, the memory would not do, or numba is missing and needed.

    Notes
    -----
    Errors of what is fitted to the sources hold for this model: observations independent of each other with the errors
    that were given, an attitude that is a spline with these knots, and nothing else unknown but the calibration.
    `formal_covariance` takes the attitude for known, as catalogues do, and `sim.observe` with a mission's `attitude` in
    µas.

    Examples
    --------
    >>> import sim
    >>> from sim.agis import System, scans
    >>> law = sim.NominalScanningLaw(years=2.0)
    >>> quasars = sim.quasars(100, rng=1)
    >>> system = System(scans(law, quasars.lon, quasars.lat, 100.0, 500.0, knots=2 * 86400.0))
    >>> place = quasars.lon, quasars.lat
    >>> ratio = system.true_covariance(1, *place) / system.formal_covariance(1, *place)
    >>> bool(ratio[3, 3] > 1)
    True
    """

    def predict(
        self, sources: ArrayLike, attitude: ArrayLike, angle: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Predict the observations by `sources` (n, 5), `attitude` (coefficients, 3) and `angle`. [µas, µas/yr]

        Returns
        -------
        along, across : (k,) arrays
            [µas]
        """
        along, across = self.passes.predict(*self._check_unknowns(sources, attitude))
        return along if angle is None or self.angle is None else along + self.angle.compute_along_shifts(angle), across

    def adjoint(self, along: ArrayLike, across: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The weighted transpose of `predict`: right-hand sides of observations `along` and `across`, (k,). [µas]"""
        return self.passes.adjoint(*self._check_observations(along, across))

    def solve(
        self,
        along: ArrayLike,
        across: ArrayLike,
        *,
        start: ArrayLike | None = None,
        attitude: ArrayLike | None = None,
        known: ArrayLike | None = None,
        first: Literal["sources", "attitude"] = "sources",
        iterations: int = 500,
        stop: float | None = 0.05,
        sources: ArrayLike | None = None,
        watch: Callable[[int, FloatArray], None] | None = None,
        checkpoint: PathName | None = None,
        progress: bool = False,
    ) -> AgisSolution:
        """Solve for the parameters of the sources and the attitude.

        Parameters
        ----------
        along, across : (k,) arrays
            Observed minus computed values, in the order of the scans. [µas]
        start : (n, 5) array, optional
            Initial corrections (default: zero). Their component in the null space is retained. [µas, µas/yr]
        attitude : (coefficients, 3) array, optional
            Attitude used in the first update of the sources (default: zero). [µas]
        known : (coefficients, 3) array, optional
            Mean of the prior on the attitude (default: zero); needs `System(prior=…)`. [µas]
        first : {"sources", "attitude"}
            The block that is updated first. If the starting values are worse for the sources than for the attitude,
            take the sources: their errors are removed in the first update.
        iterations : int
            The largest number of iterations.
        stop : float or None
            Stop when no coefficient of degrees 1 to 3 has changed by more than this many formal errors over ten
            iterations; None iterates to machine precision. Small updates do not imply convergence on large scales: with
            updates of 0.8 µas the acceleration was still off by eight formal errors.
        sources : indices or mask, optional
            Sources whose motions enter the stopping rule, the quasars say (default: all).
        watch : function, optional
            Called after every iteration with its number and the (n, 5) parameters.
        checkpoint : path, optional
            A .npz file from which an interrupted solution resumes; the result is the same to the byte.
        progress : bool
            Show a progress bar with the changes of the low degrees, after two seconds.

        Returns
        -------
        AgisSolution
            A warning is issued if it has not converged, unless `stop` is None.

        Raises
        ------
        ParameterError
            If shapes do not fit, a value is not finite, or `known` is given without a prior.
        DegeneracyError
            If the sources do not determine spin and acceleration.
        CheckpointError
            If the checkpoint belongs to a different problem.
        """
        measured, passes, n = self._check_observations(along, across), self.passes, self.scans.n_sources
        start = np.zeros((n, 5)) if start is None else start
        attitude = np.zeros((self.coefficients, 3)) if attitude is None else attitude
        x, first_attitude = self._check_unknowns(start, attitude)
        prior_rhs: Any = 0.0
        if known is not None:
            if self.prior is None:
                raise ParameterError("known= is what a prior says of the attitude: give System a prior")
            prior_rhs = arguments.float_array("known", known, (self.coefficients, 3)) / self.prior**2
        arguments.choice("first", first, ("sources", "attitude"))
        iterations = arguments.whole("iterations", iterations)
        stop = None if stop is None else arguments.positive("stop", stop)
        low_fit = fit_low_degrees(self, arguments.indices("sources", sources, n))
        if first == "sources":
            source_rhs, _ = passes.adjoint(*measured, x, first_attitude)
            x = x + self.precondition((source_rhs - _compute_constraint_terms(self, x))[..., None])[..., 0]
        source_rhs, attitude_rhs = passes.adjoint(*measured, x, np.zeros_like(first_attitude))
        attitude_rhs += prior_rhs
        remainder = None if self.angle is None else measured[0] - passes.predict(x, np.zeros_like(first_attitude))[0]
        rhs = self.reduce(source_rhs, attitude_rhs, remainder) - _compute_constraint_terms(self, x)
        rhs[~self.solved] = 0
        iteration = Iteration(self, rhs[..., None])

        sigma = np.sqrt(np.diag(low_fit.formal))
        history, updates = [low_fit.compute_coefficients(x[..., None])[:, 0]], []
        key = None
        if checkpoint is not None:
            key = digest_values((rhs, attitude_rhs, x, self.prior, self.smoothing, low_fit.sources, len(low_fit.modes)))
            state = read_checkpoint_state(checkpoint, key)
            if state is not None:
                history, updates = list(state.pop("history")), list(state.pop("updates"))
                iteration.restore(state)

        def write_checkpoint():
            if checkpoint is not None and key is not None:
                arrays = iteration.state() | {"history": np.array(history), "updates": np.array(updates)}
                write_arrays(checkpoint, {"key": np.array(key)} | arrays, overwrite=True)

        bar = progress_bar(
            total=iterations, words="joint solution", shown=progress, unit=" iterations", initial=len(history)
        )
        with bar, limit_blas(0):  # its threads would wait for each other longer than they work
            while True:
                if watch is not None:
                    watch(len(history), x + iteration.x[..., 0])
                is_settled = stop is not None and len(history) > REST and _find_max_change(history, sigma) < stop
                if is_settled or len(history) >= iterations or iteration.residual < _SOLVED_RESIDUAL:
                    break
                iteration.step()
                history.append(low_fit.compute_coefficients(x[..., None] + iteration.x)[:, 0])
                updates.append(float(np.sqrt(np.mean(iteration.z[self.solved, 2] ** 2))))
                bar.update()
                bar.set_postfix_str(
                    f"low degrees moved by {_find_max_change(history, sigma):.2g} σ in {min(REST, len(history) - 1)}",
                    refresh=False,
                )
                if len(history) % _CHECKPOINT_EVERY == 0:
                    write_checkpoint()
        write_checkpoint()
        parameters = x + iteration.x[..., 0]
        final_attitude = self.attitude_of(attitude_rhs - passes.to_attitude(iteration.x)[..., 0])
        angle = None
        if self.angle is not None:
            angle = self.angle_of(measured[0], parameters, final_attitude)
            final_attitude -= self.angle.compute_effects(angle)[2]
        scans = self.scans
        solution = AgisSolution(
            np.where(self.solved[:, None], parameters, np.nan),
            final_attitude,
            len(history),
            bool(is_settled or iteration.residual < _SOLVED_RESIDUAL),
            np.array(history),
            np.array(updates),
            low_fit.modes,
            low_fit.formal,
            self.formal,
            self.solved,
            scans.lon,
            scans.lat,
            scans.frame,
            self.motion.parameters(parameters[..., None])[:, 0] if self.motion is not None else None,
            angle,
        )
        if not solution.converged and stop is not None:
            warnings.warn(
                f"not converged after {solution.iterations} iterations: degrees 1 to {solution.modes.lmax} still "
                "change; allow more, or read large scales with care",
                VshWarning,
                stacklevel=2,
            )
        return solution

    def _check_observations(self, along, across):
        shape = (len(self.scans),)
        return arguments.float_array("along", along, shape), arguments.float_array("across", across, shape)

    def _check_unknowns(self, sources, attitude):
        x = arguments.float_array("sources", sources, (self.scans.n_sources, 5))
        return x, arguments.float_array("attitude", attitude, (self.coefficients, 3))


class Iteration:
    """(S − C A⁻¹ Cᵀ) x = r step by step, for several right-hand sides at once.

    Sources and attitude solved in turn, with the preconditioner S⁻¹, in conjugate directions: conjugate gradients with
    Gauss–Seidel's. The part of x along the null space stays what it was.
    """

    def __init__(self, equations: Any, r: FloatArray) -> None:
        self.equations = equations
        self.x, self.r = np.zeros_like(r), r.copy()
        self.z = equations.precondition(self.r)
        self.p = self.z.copy()
        self.rz = _sum_products(self.r, self.z)
        self.first = self.rz.copy()
        #: What the last step added to rᵀ N⁺ r, whose sum is a lower bound of it that only grows.
        self.gain = np.zeros_like(self.rz)

    @property
    def residual(self) -> float:
        """The largest preconditioned residual left of all right-hand sides, of the first."""
        first_rz = np.where(self.first > 0, self.first, 1.0)
        return float(np.sqrt(np.max(np.abs(self.rz) / first_rz)))

    def step(self) -> None:
        """Pass once through sources and attitude."""
        is_moving = self.rz > 0
        q = self.equations.apply(self.p)
        curvature = _sum_products(self.p, q)
        # A right-hand side that is solved to the last bit has no direction left.
        is_moving &= curvature > 0
        step_length = np.where(is_moving, self.rz / np.where(is_moving, curvature, 1.0), 0.0)
        self.x += step_length * self.p
        self.r -= step_length * q
        self.gain = step_length * self.rz
        self.z = self.equations.precondition(self.r)
        rz = _sum_products(self.r, self.z)
        conjugation = np.where(is_moving, rz / np.where(is_moving, self.rz, 1.0), 0.0)
        self.p = self.z + conjugation * self.p
        self.rz = np.where(is_moving, rz, 0.0)

    def state(self) -> dict[str, FloatArray]:
        """All that the next steps depend on."""
        return {name: getattr(self, name) for name in ("x", "r", "z", "p", "rz", "first", "gain")}

    def restore(self, state: dict[str, FloatArray]) -> None:
        """Go on from a state."""
        for name in self.state():
            setattr(self, name, np.array(state[name]))


def _sum_products(a, b):
    """Σ over sources and parameters, (K,); not by BLAS, whose threads would change the last bits."""
    return (a * b).reshape(-1, a.shape[-1]).sum(axis=0)


def read_checkpoint_state(path: PathName, key: str) -> dict[str, Any] | None:
    """Read the state that a checkpoint holds, or None where there is no file."""
    if not Path(path).exists():
        return None
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise CheckpointError(f"{path} is damaged ({error}): delete it to begin anew") from error
    if str(arrays.pop("key", "")) != key:
        raise CheckpointError(f"{path} belongs to another solution: delete it to begin anew")
    return arrays


#: Iterations within which the low degrees must have come to rest.
REST = 10
#: Iterations between two checkpoints.
_CHECKPOINT_EVERY = 5
#: Residual below which nothing is left to do in double precision.
_SOLVED_RESIDUAL = 1e-13


def _compute_constraint_terms(equations, x):
    """Constraints of a global motion on parameters, (n, 5)."""
    constraints = np.zeros_like(x)
    if equations.motion is not None:
        constraints[:, 3:] = equations.motion.weights[:, None] * x[:, 3:] - equations.motion.pull(x[..., None])[..., 0]
    return constraints


def _find_max_change(history, sigma):
    """Largest motion of a low degree in formal errors in the last iterations, at most."""
    return float(np.max(np.ptp(history[-REST - 1 :], axis=0) / sigma))
