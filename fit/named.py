"""Parameters with names and a joint covariance: what the frame solver and the drift have in common."""

from dataclasses import dataclass

import numpy as np

from fit.storage import Stored
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class NamedSolution(Stored):
    """A least-squares solution for named parameters.

    Attributes
    ----------
    names : tuple of str
    values : (p,) array
        In the order of `names`.
    covariance : (p, p) array
    chi2 : float
    n_data : int
        Two a source.
    frame : str
        Of the axes.
    """

    names: tuple
    values: np.ndarray
    covariance: np.ndarray
    chi2: float
    n_data: int
    frame: str

    @property
    def sigma(self):
        """Standard error of each parameter, (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self):
        """Correlation matrix, (p, p), rows and columns as in `names`."""
        return self.covariance / np.outer(self.sigma, self.sigma)

    @property
    def dof(self):
        return self.n_data - len(self.names)

    @property
    def spin(self):
        """ω, a Vector in µas/yr, or None where it is not among the parameters."""
        return self._vector("omega") if "omega_x" in self.names else None

    @property
    def acceleration(self):
        """ã, a Vector in µas/yr."""
        return self._vector("a")

    def _vector(self, name, unit="µas/yr"):
        start = self.names.index(f"{name}_x")
        part = slice(start, start + 3)
        return Vector(self.values[part], self.covariance[part, part], self.frame, unit)
