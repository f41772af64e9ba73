"""Likelihoods that expect wrong errors: the weight that each gives to a residual."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import minimize_scalar
from scipy.special import gamma, gammainc, gammaln

from fit.solution import Solution
from vsh.checks.types import FloatArray
from vsh.field import Field
from vsh.parts import Parts

#: Newton's steps to a source's share in its own fit, at most; with thousands of sources three are enough.
_STEPS = 10
#: Where the likelihood of ν is looked at; between them it is a polynomial of ln ν, exact to 1e-12.
_NODES = chebyshev.chebpts1(36)
_LOW, _HIGH = np.log([0.5, 200.0])


@dataclass(frozen=True)
class StudentT:
    """Weights of the t distribution of so many components, and their slopes by X²."""

    nu: float
    estimated: bool
    components: int = 2

    def __call__(self, x2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u and its slope, (n,) each."""
        u = (self.nu + self.components) / (self.nu + x2)
        return u, -u / (self.nu + x2)

    def fitted(self, sky: Parts, share: Share, words: str) -> StudentT:
        """The same with the likeliest ν, from residuals and shares by the ν that was."""
        if not self.estimated:
            return self
        n, logs = sky.sum(partial(_log_terms, share=share), roles=(), words=words)
        return replace(self, nu=_likeliest_nu(logs / n, self.components))


@dataclass(frozen=True)
class Permissive:
    """Weights of Sivia's likelihood and their slopes by X²."""

    nu: None = None
    components: int = 2

    def __call__(self, x2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u and its slope, (n,) each."""
        q = np.maximum(x2 / 2, 1e-8)
        i2, i4, i6 = (gamma(a) * gammainc(a, q) / q**a for a in (self.components + 1) / 2 + np.arange(3))
        return i4 / i2, (np.square(i4 / i2) - i6 / i2) / 2

    def fitted(self, sky: Parts, share: Share, words: str) -> Permissive:
        """The same: it has nothing to fit."""
        return self


@dataclass(frozen=True)
class Share:
    """What weighs each source: its residual from a solution, and its share in its own fit.

    Attributes
    ----------
    solution : Solution
        Of the round before.
    weight : function
        X² → u and its slope.
    leverage : float
        By which u tr W is multiplied for the share: p over Σ u tr W and the components.
    """

    solution: Solution
    weight: Any
    leverage: float

    def __call__(self, field: Field) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """X² over one less the share, u and its slope, each (n,); and the residuals, (components, n)."""
        residual = self.solution.residuals(field)
        chi2, largest = residual.chi2, self.leverage * field.information
        own = np.zeros(len(field))
        # The share depends on u, and u on the share, the less the larger it is: Newton's steps to where both agree.
        for _ in range(_STEPS):
            x2 = chi2 / (1 - own)
            u, slope = self.weight(x2)
            step = (np.minimum(largest * u, 0.9) - own) / (1 - largest * slope * x2 / (1 - own))
            own = np.clip(own + step, 0.0, 0.9)
            if np.max(np.abs(step)) < 1e-13:
                break
        x2 = chi2 / (1 - own)
        return x2, *self.weight(x2), residual.data


def _log_terms(field, share):
    """How many sources, and Σ ln(1 + X²/ν) at the nodes of ln ν."""
    x2 = share(field)[0]
    nus = np.exp(_LOW + (_HIGH - _LOW) * (_NODES + 1) / 2)
    return len(field), np.array([np.log1p(x2 / nu).sum() for nu in nus])


def _likeliest_nu(mean_logs, components):
    """ν of the t distribution of k components, p(X²) ∝ (1 + X²/ν)^{−(ν+k)/2}, that makes the X² likeliest."""
    terms = chebyshev.chebfit(_NODES, mean_logs, len(_NODES) - 1)

    def loss(log_nu):
        nu = np.exp(log_nu)
        constant = gammaln((nu + components) / 2) - gammaln(nu / 2) - components / 2 * np.log(nu)
        return -(constant - (nu + components) / 2 * chebyshev.chebval(2 * (log_nu - _LOW) / (_HIGH - _LOW) - 1, terms))

    return float(np.exp(minimize_scalar(loss, bounds=(_LOW, _HIGH), method="bounded").x))
