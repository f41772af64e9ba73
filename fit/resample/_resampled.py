"""A solution and its replicates: what every resampling gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from fit.solution import AboutSolution, Solution
from vsh.checks.arguments import between
from vsh.checks.types import FloatArray, Table
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class Resampled(AboutSolution):
    """A solution and its replicates from resampled sources.

    Attributes
    ----------
    method : str
    solution : Solution
        Of the sources as they are.
    replicates : (n, p) array
        Coefficients of each replicate. [µas/yr]
    covariance : (p, p) array
        Of the coefficients, estimated from the replicates. [(µas/yr)²]
    """

    method: str
    solution: Solution
    replicates: FloatArray
    covariance: FloatArray

    def report(self) -> str:
        """The solution with these errors, as text."""
        return self.resampled_solution.report()

    def to_table(self) -> Table:
        """The coefficients with these errors as an astropy Table, a row each."""
        return self.resampled_solution.to_table()

    def plot(self, *, ax: Any = None) -> Any:
        """Power by degree with these errors on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        return self.resampled_solution.plot(ax=ax)

    @property
    def samples(self) -> FloatArray:
        """Another name of `replicates`."""
        return self.replicates

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each coefficient, (p,). [µas/yr]"""
        return np.sqrt(np.diag(self.covariance))

    @property
    def resampled_solution(self) -> Solution:
        """The solution with this covariance in place of N⁻¹: its `spin` and `acceleration` carry these errors."""
        source = f"the {self.method}, {len(self.replicates)} replicates"
        dof = len(self.replicates) - 1.0
        return replace(self.solution, covariance=self.covariance, errors_from=source, covariance_dof=dof)

    @property
    def spin(self) -> Vector:
        """The spin with these errors, a Vector. [µas/yr]"""
        return self.resampled_solution.spin

    @property
    def acceleration(self) -> Vector:
        """The acceleration with these errors, a Vector. [µas/yr]"""
        return self.resampled_solution.acceleration

    def interval(self, probability: float = 0.68) -> FloatArray:
        """Lower and upper end of each coefficient's interval, (2, p). [µas/yr]

        Percentiles of the replicates; for the jackknife, whose replicates lie close together, the
        interval of its standard error with Student's t, which allows for few blocks.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        """
        probability = between("probability", probability, 0, 1)
        if self.method == "jackknife":
            reach = stdtrit(len(self.replicates) - 1, 0.5 + probability / 2) * self.sigma
            return self.solution.coefficients.values + np.array([[-1], [1]]) * reach
        return np.percentile(self.replicates, [50 - 50 * probability, 50 + 50 * probability], axis=0)
