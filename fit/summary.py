"""What a solution gives besides its coefficients: a summary, predictions, draws, and the BIC."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vsh.field import Field
from vsh.io import tables
from vsh.tools.arguments import generator, whole
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, Rng, Table

if TYPE_CHECKING:
    from collections.abc import Callable

    from vsh.coefficients import Coefficients


class Summarised:
    """The mixin of solutions for coefficients of motions."""

    coefficients: Coefficients
    covariance: FloatArray
    covariance_dof: float
    chi2: float
    n_data: int
    by_prior: float
    frame: str
    unit: str
    formal: Any
    model: Callable[[Field], FloatArray]

    def summary(self) -> Table:
        """Spin and acceleration as an astropy Table: a row for each component, with errors and 68 % intervals."""
        from fit.output import vectors_of

        formal = vectors_of(self.formal)
        rows: list[Any] = [
            (f"{name}_{axis}", value, error, alone, value - error, value + error)
            for name, vector in vectors_of(self).items()
            for axis, value, error, alone in zip("xyz", vector.value, vector.sigma, formal[name].sigma, strict=True)
        ]
        names = ("parameter", "value", "error", "formal_error", "low_68", "high_68")
        columns = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
        unit = self.unit.replace("µ", "u")
        return tables.table_of(columns, {"frame": self.frame}, dict.fromkeys(names[1:], unit) if unit else {})

    def predict(self, lon: ArrayLike | Field, lat: ArrayLike | None = None) -> FloatArray:
        """The fitted motions at places, (2, n): east and north component. [µas/yr]

        Parameters
        ----------
        lon, lat : (n,) arrays
            Places in the frame of the solution [rad]; or a Field alone, whose sources are taken.

        Raises
        ------
        ParameterError
            If there is a longitude without a latitude.
        """
        if isinstance(lon, Field):
            lon.check_frame(self.frame)
            return self.model(lon)
        if lat is None:
            raise ParameterError("predict takes lon and lat in radians, or a Field")
        return self.coefficients.at(lon, lat)

    def sample(self, n: int, *, rng: Rng = 1) -> FloatArray:
        """Draw coefficients from their distribution, (n, p): normal, or Student's t where replicates gave the errors.

        Parameters
        ----------
        n : int
            How many draws.
        rng : Generator or int
            The source of all randomness.
        """
        random, values = generator(rng), self.coefficients.values
        draws = random.multivariate_normal(np.zeros(len(values)), self.covariance, size=whole("n", n))
        if np.isfinite(self.covariance_dof):
            draws /= np.sqrt(random.chisquare(self.covariance_dof, (n, 1)) / self.covariance_dof)
        return values + draws

    @property
    def bic(self) -> float:
        """The Bayesian information criterion, χ² + k ln n, up to a constant of the data: smaller is better.

        It compares degrees by the catalogue's errors; `fit.background.evidence` compares them without that assumption.
        """
        k = len(self.coefficients.values) - self.by_prior
        return float(self.chi2 + k * np.log(self.n_data))
