"""The prior on our velocity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fit.sampling import named_function
from vsh.checks.types import FloatArray
from vsh.cosmology import PLANCK_2018
from vsh.errors import ParameterError
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class VelocityPrior:
    """Density of our velocity along the axes of one frame.

    Attributes
    ----------
    mean, precision : (3,) and (3, 3) arrays or None
        Of a Gaussian; None for others [km/s]
    function : callable or None
        (n, 3) km/s → (n,) log-densities.
    name : str
        For the fingerprint of a chain.
    words : str
        For reports.
    """

    name: str
    mean: FloatArray = field(default_factory=lambda: np.zeros(3))
    precision: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    function: Callable[[FloatArray], FloatArray] | None = None
    words: str = ""

    @property
    def proper(self) -> bool:
        """Whether its integral is finite."""
        return self.name not in ("flat", "flat-product")

    @property
    def in_product(self) -> bool:
        """Whether the density is flat in u = v H0, not in v: p(v, H0) = p(H0) H0³."""
        return self.name == "flat-product"

    @property
    def gaussian(self) -> bool:
        """Whether it is a Gaussian, the flat one (precision zero) among them."""
        return self.function is None

    def log(self, v: FloatArray) -> FloatArray:
        """Log-density at velocities v, (n, 3)."""
        if self.function is not None:
            return np.asarray(self.function(v), float)
        away = v - self.mean
        _, logdet = np.linalg.slogdet(self.precision) if self.proper else (1, 0.0)
        return (logdet - np.einsum("ni,ij,nj->n", away, self.precision, away)) / 2


def velocity_prior(value: Any, frame: str) -> VelocityPrior:
    """A velocity prior along the axes of `frame`."""
    if isinstance(value, str) and value in ("flat", "flat-product"):
        return VelocityPrior(value, np.zeros(3), np.zeros((3, 3)))
    if isinstance(value, str) and value == "planck":
        value = PLANCK_2018
    if isinstance(value, Vector):
        turned = value.to_frame(frame)
        if not np.linalg.eigvalsh(turned.covariance)[0] > 0:
            raise ParameterError("a Gaussian prior on the velocity needs errors in all three components")
        precision = np.linalg.inv(turned.covariance)
        l, b = value.to_frame("galactic").direction
        words = f"{value.amplitude:.2f} ± {value.amplitude_error:.2g} km/s toward l = {l:.2f}°, b = {b:+.2f}°"
        return VelocityPrior(
            f"Gaussian {value.value} {value.sigma} {value.frame}", turned.value, precision, words=words
        )
    if callable(value):
        return VelocityPrior(f"function {named_function(value)}", function=value)
    raise ParameterError(f"a velocity prior is 'planck', 'flat', 'flat-product', a Vector or a function, not {value!r}")
