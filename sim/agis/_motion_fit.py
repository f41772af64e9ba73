"""A fit of vector spherical harmonics to the motions of a joint solution, as functionals of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from vsh.basis import harmonics
from vsh.errors import DegeneracyError
from vsh.modes import Modes
from vsh.types import ArrayLike, FloatArray


class MotionFit:
    """The weighted fit that takes sources for independent, with their formal covariances.

    Parameters
    ----------
    equations : Equations
        Whose sources.
    modes : Modes
        Of the fit.
    sources : (m,) int array
        Those that are fitted.
    """

    def __init__(self, equations: Any, modes: Modes, sources: FloatArray) -> None:
        self.modes, self.equations = modes, equations
        self.sources = sources[equations.solved[sources]]
        scans = equations.scans
        field = harmonics(scans.lon[self.sources], scans.lat[self.sources], modes)
        weights = np.linalg.inv(equations.formal[self.sources][:, 3:, 3:])
        weighted = np.einsum("nij,pjn->pin", weights, field)
        normal = field.reshape(len(modes), -1) @ weighted.reshape(len(modes), -1).T
        scale = 1 / np.sqrt(np.diag(normal))
        if np.linalg.eigvalsh(normal * np.outer(scale, scale))[0] < 1e-10:
            raise DegeneracyError(f"{len(self.sources)} sources do not determine degree {modes.lmax}: lower it")
        #: As quoted, (p, p).
        self.formal = np.linalg.inv(normal)
        self.rows = np.tensordot(self.formal, weighted, 1)

    def of(self, x: FloatArray) -> FloatArray:
        """Coefficients of given parameters, (p, K).

        Parameters
        ----------
        x : (n, 5, K) array
            Of all sources.

        Returns
        -------
        array
        """
        motions = x[self.sources, 3:].transpose(1, 0, 2)
        return self.rows.reshape(len(self.modes), -1) @ motions.reshape(-1, x.shape[-1])

    def functionals(self, which: ArrayLike) -> FloatArray:
        """The g of some coefficients, c = Σ g x: (n, 5, K).

        Parameters
        ----------
        which : (K,) int array
            Which.

        Returns
        -------
        array
        """
        rows = self.rows[np.asarray(which)]
        out = np.zeros((self.equations.scans.n_sources, 5, len(rows)))
        out[self.sources, 3:] = rows.transpose(2, 1, 0)
        return out
