"""What all linear least-squares solutions have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from fit.quality import Quality
from fit.storage import Result
from vsh.checks.types import FloatArray
from vsh.field import Field
from vsh.vector import correlation_of


class LinearSolution(Result):
    """A least-squares solution: parameters with a covariance, and how well they fit.

    Attributes
    ----------
    names : tuple of str
        Of the parameters.
    values : (p,) array
        The parameters.
    covariance : (p, p) array
        Of the parameters, in the order of `names`.
    chi2 : float
        Of the residuals.
    n_data : int
        Data points: two a source.
    frame : str
        Of the axes.
    notes : tuple of str
        What the reader should know of the data.
    """

    names: Any
    values: Any
    covariance: Any
    chi2: float
    n_data: int
    frame: str
    notes: tuple[str, ...]

    @abstractmethod
    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a field, (2, n). [µas/yr]

        Parameters
        ----------
        field : Field
            In the frame of the solution.
        """

    @property
    def n_sources(self) -> int:
        """How many sources were fitted."""
        return self.n_data // 2

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each parameter, (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the parameters, (p, p)."""
        return correlation_of(self.covariance)

    @property
    def dof(self) -> int:
        """Degrees of freedom: data points less parameters."""
        return self.n_data - len(self.names)

    @property
    def quality(self) -> Quality:
        """What χ² says of the errors, a `fit.quality.Quality`."""
        return Quality(self.chi2, self.dof)

    @property
    def reduced_chi2(self) -> float:
        """χ² per degree of freedom; nan where there is none."""
        return self.quality.reduced

    def residuals(self, field: Field) -> Field:
        """The field less the model: a Field, whose `chi2` is that of each source.

        Its `.whitened` are the residuals decorrelated and in units of their errors.

        Parameters
        ----------
        field : Field
            In the frame of the solution.

        Raises
        ------
        FrameError
            If the field is in another frame.
        """
        field.check_frame(self.frame)
        return field.minus(self.model(field))
