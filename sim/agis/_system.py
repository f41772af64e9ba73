"""The joint solution, as its users meet it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Literal

import numpy as np

from sim.agis._errors import ExactErrors
from sim.agis._globals import GlobalMotion
from sim.agis._motion_fit import low_fit
from sim.agis._solve import solve_observations
from sim.agis.passes import Scans
from sim.agis.results import AgisSolution
from vsh.checks import arguments, arrays
from vsh.checks.types import ArrayLike, FloatArray, PathName
from vsh.errors import ParameterError, VshWarning

#: Second differences smaller than this are a statement on the attitude, not a bridge over gaps. [µas]
ROUGH = 1e4


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
        By numba, or without (for some million transits at most); by numba unless it is missing.

    Raises
    ------
    DegeneracyError
        If nothing is measured across the scan and there is no prior, if there are more unknowns than observations, if no
        source has transits enough; or if a coefficient of the attitude is not determined, which the message names.
    ParameterError
        If a number is not above zero, the memory would not do, or numba is missing and needed.

    Notes
    -----
    Errors of what is fitted to the sources hold for this model: observations independent of each other with the errors that
    were given, an attitude that is a spline with these knots, and nothing else unknown. `formal_covariance` takes the
    attitude for known, as catalogues and `sim.observe` with a mission's `attitude` in µas do; `true_covariance` does not.

    Examples
    --------
    >>> import sim
    >>> from sim.agis import System, scans
    >>> law = sim.NominalScanningLaw(years=2.0)
    >>> quasars = sim.quasars(100, rng=1)
    >>> system = System(scans(law, quasars.lon, quasars.lat, 100.0, 500.0, knots=2 * 86400.0))
    >>> ratio = system.true_covariance(1, quasars.lon, quasars.lat) / system.formal_covariance(1, quasars.lon, quasars.lat)
    >>> bool(ratio[3, 3] > 1)
    True
    """

    def __init__(
        self,
        scans: Scans,
        prior: float | None = None,
        *,
        smoothing: float = 1e6,
        motion: GlobalMotion | None = None,
        threads: int | None = None,
        compiled: bool | None = None,
    ) -> None:
        arguments.a(Scans)("scans", scans)
        if motion is not None:
            arguments.a(GlobalMotion)("motion", motion)
        prior = None if prior is None else arguments.positive("prior", prior)
        if arguments.positive("smoothing", smoothing) < ROUGH:
            warnings.warn(
                f"smoothing of {smoothing:g} µas is a statement on the attitude: errors hold only where its coefficients really "
                f"bend no more; {ROUGH:g} and more bridge gaps alone",
                VshWarning,
                stacklevel=2,
            )
        super().__init__(scans, prior, float(smoothing), motion, threads, compiled)

    def predict(self, sources: ArrayLike, attitude: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """What parameters make of the observations.

        Parameters
        ----------
        sources : (n, 5) array
            [µas, µas/yr]
        attitude : (coefficients, 3) array
            [µas]

        Returns
        -------
        along, across : (k,) arrays
            [µas]
        """
        return self.passes.predict(*self._shaped(sources, attitude))

    def adjoint(self, along: ArrayLike, across: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The weighted transpose of `predict`: the right-hand sides of observations.

        Parameters
        ----------
        along, across : (k,) arrays
            [µas]
        """
        return self.passes.adjoint(*self._observed(along, across))

    def solve(
        self,
        along: ArrayLike,
        across: ArrayLike,
        *,
        start: ArrayLike | None = None,
        attitude: ArrayLike | None = None,
        known: ArrayLike | None = None,
        first: Literal["sources", "attitude"] = "sources",
        method: Literal["conjugate", "simple"] = "conjugate",
        iterations: int = 500,
        stop: float | None = 0.05,
        sources: ArrayLike | None = None,
        watch: Callable[[int, FloatArray], None] | None = None,
        checkpoint: PathName | None = None,
        progress: bool = False,
    ) -> AgisSolution:
        """Sources and attitude from observations.

        Parameters
        ----------
        along, across : (k,) arrays
            Observed less what was expected, in the order of the scans. [µas]
        start : (n, 5) array, optional
            Corrections to begin with; none unless given. What they hold of the null space stays. [µas, µas/yr]
        attitude : (coefficients, 3) array, optional
            The attitude that a first update of the sources begins with; none unless given. [µas]
        known : (coefficients, 3) array, optional
            What a prior says of the attitude; zero unless given. [µas]
        first : {"sources", "attitude"}
            What is updated first. With a start that is worse for the sources than for the attitude, sources: their errors
            are gone at once.
        method : {"conjugate", "simple"}
            Conjugate gradients, or sources and attitude in turn, which creeps.
        iterations : int
            At most.
        stop : float or None
            Stop when no coefficient of degrees 1 to 3 has moved by so many formal errors in ten iterations; None goes on
            to the last digits. Updates of parameters say nothing of large scales: those of 0.8 µas have left the
            acceleration eight formal errors off.
        sources : indices or mask, optional
            Whose motions the rule looks at, as quasars among stars; all unless given.
        watch : function, optional
            Called after every iteration with its number and the (n, 5) parameters.
        checkpoint : path, optional
            A .npz file from which a solution that was killed goes on to the same bytes.
        progress : bool
            Show a bar with what the low degrees do, after two seconds.

        Returns
        -------
        AgisSolution
            A warning says so if it has not converged.

        Raises
        ------
        ParameterError
            If shapes do not fit, a value is not finite, or `known` has no prior.
        CheckpointError
            If the checkpoint is of another problem.
        """
        observed = self._observed(along, across)
        n = self.scans.n_sources
        shaped = self._shaped(np.zeros((n, 5)) if start is None else start, np.zeros((self.coefficients, 3)) if attitude is None else attitude)  # fmt: skip
        if known is not None:
            if self.prior is None:
                raise ParameterError("known= is what a prior says of the attitude: give System a prior")
            known = arrays.float_array("known", known, (self.coefficients, 3))
        arguments.choice("first", first, ("sources", "attitude"))
        arguments.choice("method", method, ("conjugate", "simple"))
        found = solve_observations(
            self, *observed, start=shaped[0], attitude=shaped[1], known=known, first=first, conjugate=method == "conjugate",
            iterations=arguments.whole("iterations", iterations),
            stop=None if stop is None else arguments.positive("stop", stop), fit=low_fit(self, arrays.indices("sources", sources, n)),
            watch=watch, checkpoint=checkpoint, progress=progress,
        )  # fmt: skip
        if not found.converged and stop is not None:
            warnings.warn(
                f"not at rest after {found.iterations} iterations: degrees 1 to {found.modes.lmax} still move; allow more, or read "
                "large scales with care",
                VshWarning,
                stacklevel=2,
            )
        return found

    def _observed(self, along, across):
        shape = (len(self.scans),)
        return arrays.float_array("along", along, shape), arrays.float_array("across", across, shape)

    def _shaped(self, sources, attitude):
        x = arrays.float_array("sources", sources, (self.scans.n_sources, 5))
        return x, arrays.float_array("attitude", attitude, (self.coefficients, 3))
