"""What a joint solution found, and what its errors are like: by magnitude and place, and systematic errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from sim.astrometry import COMPONENTS, split_covariance
from sim.signal import Signal, as_signal
from vsh import Field
from vsh.coefficients import Coefficients
from vsh.modes import Modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class AgisSolution(Frozen):
    """Corrections to sources and attitude: estimate less truth, where the observations were noise alone.

    Attributes
    ----------
    sources : (n, 5) array
        α*, δ, ϖ, µ_α*, µ_δ; nan for sources with too few transits. [µas, µas/yr]
    attitude : (coefficients, 3) array
        Coefficients of the spline, along the axes of `frame`. [µas]
    iterations : int
        Updates of the sources, the first among them.
    converged : bool
        By the rule that was asked for.
    history : (iterations, p) array
        Coefficients of the low degrees after each. [µas/yr]
    updates : (iterations − 1,) array
        Preconditioned residuals of the parallax, rms. [µas]
    modes, formal_low : Modes, (p, p) array
        Modes of the history; its covariance as quoted.
    formal : (n, 5, 5) array
        Covariances of each source for itself, the attitude taken as known: as quoted.
    solved : (n,) bool array
        Which sources have a solution.
    lon, lat, frame
        Positions of the sources.
    global_parameters : (k,) array or None
        Parameters of a global motion.
    angle : (coefficients,) array or None
        Coefficients of the basic angle that were calibrated, in the order of `Calibration.columns`. [µas]
    notes : tuple of str
        What became of it since.
    """

    sources: FloatArray
    attitude: FloatArray
    iterations: int
    converged: bool
    history: FloatArray
    updates: FloatArray
    modes: Modes
    formal_low: FloatArray
    formal: FloatArray
    solved: BoolArray
    lon: FloatArray
    lat: FloatArray
    frame: str
    global_parameters: FloatArray | None = None
    angle: FloatArray | None = None
    notes: tuple[str, ...] = field(default=())

    def field(
        self,
        truth: Signal | Coefficients | None = None,
        *,
        sources: ArrayLike | None = None,
        kind: Literal["motion", "position"] = "motion",
        magnitude: ArrayLike | None = None,
    ) -> Field:
        """The motions, or the position offsets, of some sources with the errors that would be quoted.

        Quoted errors are those of each source for itself, as catalogues have them: sources that share a piece of the
        attitude share errors that these do not tell. `System.true_covariance` does.

        Parameters
        ----------
        truth : Signal or Coefficients, optional
            True motions to which the errors are added; none unless given. [µas/yr]
        sources : indices or mask, optional
            All unless given.
        kind : {"motion", "position"}
            Which two of the five parameters.
        magnitude : (n,) array, optional
            Magnitudes of all sources.

        Returns
        -------
        Field
            The sources that are solved; a note counts the others.

        Raises
        ------
        ParameterError
            If the kind is unknown, or there are no such sources.
        """
        columns = COMPONENTS[arguments.choice("kind", kind, ("position", "motion"))]
        n = len(self.lon)
        candidates = arguments.indices("sources", sources, n)
        indices = candidates[self.solved[candidates]]
        if not len(indices):
            raise ParameterError(f"none of {len(candidates)} sources is solved")
        notes = [
            (
                f"simulated: sources and attitude solved together in {self.iterations} iterations; errors are those of "
                "each source alone"
            ),
            *self.notes,
        ]
        if not self.converged:
            notes.append("the joint solution had not come to rest: large scales are not what they will be")
        if len(indices) < len(candidates):
            notes.append(
                f"left out {len(candidates) - len(indices)} of {len(candidates)} sources: too few transits for five "
                "parameters"
            )
        g = None if magnitude is None else arguments.float_array("magnitude", magnitude, (n,), finite=False)[indices]
        lon, lat, covariance = self.lon[indices], self.lat[indices], self.formal[indices][:, columns, columns]
        motion = self.sources[indices][:, columns].T
        if truth is not None:
            motion = motion + as_signal(truth)(lon, lat, None)
        return Field(lon, lat, motion, *split_covariance(covariance), magnitude=g, frame=self.frame, notes=tuple(notes))

    def rotated(self, orientation: ArrayLike, spin: ArrayLike, note: str = "") -> AgisSolution:
        """Turn positions and motions of the sources back by ε₀ + ω t; attitude and history stay as they were solved.

        Parameters
        ----------
        orientation, spin : (3,) arrays
            ε₀ and ω, taken away from positions and motions. [µas, µas/yr]
        note : str
            Why.
        """
        p, q, _ = triad(self.lon, self.lat)
        sources = self.sources.copy()
        for columns, name, value in ((slice(0, 2), "orientation", orientation), (slice(3, 5), "spin", spin)):
            vector = arguments.float_array(name, value, (3,))
            sources[:, columns] -= np.stack([vector @ q, -(vector @ p)], axis=1)
        return replace(self, sources=sources, notes=(*self.notes, note) if note else self.notes)
