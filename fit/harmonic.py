"""What solutions for coefficients say, with or without their full covariance."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtrc, fdtrc

from fit.linear import LinearSolution
from vsh.checks.types import FloatArray, Kind
from vsh.coefficients import FIRST_DEGREE, Coefficients, vector_of
from vsh.field import Field
from vsh.modes import Modes
from vsh.vector import Vector


class HarmonicSolution(LinearSolution):
    """What a solution for coefficients says, with or without their full covariance.

    Attributes
    ----------
    coefficients : Coefficients
        The best fit. [µas/yr]
    """

    coefficients: Coefficients
    #: Where the covariance is from; of a solution that has one.
    errors_from: str
    #: Of a covariance that was not estimated from replicates.
    covariance_dof: float = float("inf")
    #: Of the coefficients.
    unit: str = "µas/yr"

    @property
    def modes(self) -> Modes:
        """The Modes that were fitted."""
        return self.coefficients.modes

    @property
    def n_sources(self) -> int:
        """How many sources were fitted."""
        return self.n_data // self.modes.components

    @property
    def scaled(self) -> HarmonicSolution:
        """The same solution; one with a covariance may scale its errors."""
        return self

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, (p,)."""
        return tuple(map(str, self.modes))

    @property
    def values(self) -> FloatArray:
        """The coefficients as an array, (p,). [µas/yr]"""
        return self.coefficients.values

    def model(self, field: Any) -> FloatArray:
        """What the solution predicts at the sources of a field, (2, n), or (n,) of a scalar field. [µas/yr]

        Parameters
        ----------
        field : Field or ScalarField
            The sources.
        """
        return at_sources(self.coefficients, field)

    @property
    def spin(self) -> Vector:
        """The spin ω of the frame, a Vector. [µas/yr]"""
        return self._first_degree("T", FIRST_DEGREE, self.unit)

    @property
    def acceleration(self) -> Vector:
        """The acceleration ã of the Solar System, in apparent motion, a Vector. [µas/yr]"""
        return self._first_degree("S", FIRST_DEGREE, self.unit)

    def power(self, kind: Kind, l: int, *, debiased: bool = True) -> float:
        """Power of one kind and degree, ∫ |V_l|² dΩ. [(µas/yr)²]

        Noise adds Σ σ² (with the weights of the power) on average; it is taken away
        unless `debiased` is false, so that a small power may come out negative.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.
        debiased : bool
            Take away what noise gives on average.
        """
        values, _ = self.of_degree(kind, l)
        power = float(self._power_weights(l) @ values**2)
        return power - self.noise_power(kind, l) if debiased else power

    def of_degree(self, kind: Kind, l: int) -> tuple[FloatArray, FloatArray]:
        """Coefficients of one kind and degree, (2l + 1,), with their covariance: what its power and p-value are of.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        tuple[array, array]
            [µas/yr], [(µas/yr)²]
        """
        degree = self.modes.slice_of(kind, l)
        return self.coefficients.values[degree], self.covariance[degree, degree]

    def noise_power(self, kind: Kind, l: int) -> float:
        """The power that noise alone gives on average. [(µas/yr)²]

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.
        """
        return float(np.trace(self._weighted_covariance(kind, l)))

    def power_error(self, kind: Kind, l: int) -> float:
        """Standard error of the power. [(µas/yr)²]

        For Gaussian errors var(cᵀ W c) = 4 µᵀ W C W µ + 2 tr (W C)², with W the weights 1 and
        2 of the power; µᵀ W C W µ is estimated without bias, and taken for zero where the degree is not
        significant at 5 %: otherwise errors of powers without a signal come out a quarter too large.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.
        """
        values, covariance = self.of_degree(kind, l)
        wc = self._weighted_covariance(kind, l)
        wcwc = np.trace(wc @ wc)
        wc_c = self._power_weights(l) * values
        signal = max(0.0, wc_c @ covariance @ wc_c - wcwc)
        if not self.p_value(kind, l) <= 0.05:
            signal = 0.0
        return float(np.sqrt(4 * signal + 2 * wcwc))

    def p_value(self, kind: Kind, l: int) -> float:
        """Probability that noise alone gives this degree as much signal or more.

        W̃ = cᵀ C⁻¹ c over the 2l + 1 coefficients is χ² with 2l + 1 degrees of freedom
        when the true ones are zero, whatever the sky coverage. Where C was estimated from replicates, it is
        Hotelling's T²; nan where they are too few to determine it.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.
        """
        chi2, n, dof = self.chi2_of_degree(kind, l), 2 * l + 1, self.covariance_dof
        if np.isinf(dof):
            return float(chdtrc(n, chi2))
        free = dof - n + 1
        return float(fdtrc(n, free, chi2 * free / (n * dof))) if free > 0 else float("nan")

    def chi2_of_degree(self, kind: Kind, l: int) -> float:
        """W̃ = cᵀ C⁻¹ c over the coefficients of one kind and degree; nan where too few replicates determine C.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.
        """
        if self.covariance_dof < 2 * l + 1:
            return float("nan")
        values, covariance = self.of_degree(kind, l)
        return float(values @ np.linalg.solve(covariance, values))

    def _first_degree(self, kind, rows, unit):
        degree = self.modes.slice_of(kind, 1)
        return vector_of(rows, self.coefficients.values[degree], self.covariance[degree, degree], self.frame, unit)

    def _weighted_covariance(self, kind, l):
        return self._power_weights(l)[:, None] * self.of_degree(kind, l)[1]

    @staticmethod
    def _power_weights(l):
        return np.array([1.0] + 2 * l * [2.0])


def at_sources(coefficients: Coefficients, field: Field) -> FloatArray:
    """The motions of coefficients at the sources of a field, (2, n); by the transform for many of them."""
    if len(field) < 10_000:
        return coefficients.at(field.lon, field.lat)
    from vsh.transform import synthesis  # ducc0, for many sources only

    return synthesis(coefficients, field.lon, field.lat)
