"""What classes share where their noise is shared, too: several catalogues of the same sources against one of them.

The normal matrix of all classes together, A, has blocks between any two; else all is as in `fit.background._blocks`:
Cov(s_i, s_j) = C_ij S with C = a² 11ᵀ + diag(b_i²), where a is now what the reference has by itself, which all
differences from it show, and b_i what catalogue i has.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from fit.background._blocks import Blocks, ClassEquations, parities
from fit.background._draws import lots_of
from fit.background._floor import usual_shapes
from fit.background._shared import SharedErrors, drawn, spectra_of
from vsh.models.covariance import Spectrum
from vsh.modes import Modes
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError
from vsh.tools.types import FloatArray, Rng


@dataclass(frozen=True, eq=False)
class JointEquations:
    """Normal equations of degrees 2 … L of all classes, degree 1 of all eliminated, and degree 1 by itself."""

    matrix: FloatArray
    rhs: FloatArray
    first: FloatArray
    first_rhs: FloatArray
    leverage: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray, rhs: FloatArray, modes: Modes) -> "JointEquations":
        """From the normal equations, (K, p, K, p) and (K, p)."""
        k = len(rhs)
        low, high = modes.degrees == 1, modes.degrees > 1
        n, q = int(low.sum()), int(high.sum())
        first = matrix[:, low][:, :, :, low].reshape(k * n, k * n)
        across = matrix[:, low][:, :, :, high].reshape(k * n, k * q)
        if np.linalg.cond(first) > 1e12:
            raise DegeneracyError("sources in common do not determine rotation and glide of all catalogues")
        leverage: Any = np.linalg.solve(first, across)
        inner = matrix[:, high][:, :, :, high].reshape(k * q, k * q) - across.T @ leverage
        first_rhs = rhs[:, low].ravel()
        left = np.asarray(rhs[:, high].ravel() - leverage.T @ first_rhs, float)
        return cls(inner.reshape(k, q, k, q), left.reshape(k, q), first, first_rhs, leverage)

    @property
    def classes(self) -> list[ClassEquations]:
        """Each by itself: what units of the amplitudes are taken from."""
        out = []
        for i in range(len(self.rhs)):
            own = slice(6 * i, 6 * i + 6)
            leverage = self.leverage.reshape(-1, *self.rhs.shape)[own, i]
            out.append(
                ClassEquations(
                    self.matrix[i, :, i], self.rhs[i], self.first[own, own], self.first_rhs[own], leverage, 1.0, 1.0
                )
            )
        return out


class JointBlocks(Blocks):
    """ln L of the amplitudes x = (a, b_1 … b_K), as `Blocks`, of classes whose noise is shared."""

    def __init__(self, joint: JointEquations, modes: Modes, variances: FloatArray, own: str) -> None:
        super().__init__(joint.classes, modes, variances, own)
        high = modes.degrees > 1
        order = np.argsort(parities(modes)[high], kind="stable")
        self.joint = joint
        self.whole = joint.matrix[:, order][:, :, :, order]
        self.whole_leverage = joint.leverage.reshape(-1, *joint.rhs.shape)[:, :, order]

    def _fill(self, gram: FloatArray, root: FloatArray) -> None:
        """Set Rᵀ A R of each draw, (n, K, q, K, q)."""
        for each, one in zip(gram, root, strict=True):
            r = one[self.group].transpose(1, 2, 0) * self.root
            half = np.einsum("nil,mknl->mkil", r, self.whole, optimize=True)
            each[...] = np.einsum("mjk,mkil->jkil", r, half, optimize=True)

    def _seen(self, r):
        """Rᵀ A, and the diagonal over modes of A for each pair of classes, (K, K, q)."""
        k, q = self.n_classes, self.size
        across = np.einsum("mjk,mknl->jknl", r, self.whole, optimize=True).reshape(k * q, k * q)
        return across, np.einsum("iljl->ijl", self.whole)

    def degree_one(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """θ of all classes, (K, 6), and its covariance, (K, 6, K, 6): what degrees 2 … L leave, and C ⊗ S_1."""
        r, lower, w = self.factor(x)
        k, q = self.n_classes, self.size
        across = np.einsum("mjk,amk->jka", r, self.whole_leverage).reshape(k * q, -1)
        z = solve_triangular(lower, across, lower=True, check_finite=False)
        covariance = (z.T @ z + np.linalg.inv(self.joint.first)).reshape(k, 6, k, 6)
        plain = np.linalg.solve(self.joint.first, self.joint.first_rhs) - z.T @ w
        return plain.reshape(k, 6), self._with_shares(x, covariance)


def shared_jointly(
    matrix: FloatArray,
    rhs: FloatArray,
    modes: Modes,
    *,
    shapes: Sequence[str | Spectrum] | None = None,
    draws: int = 400,
    rng: Rng = 1,
    **facts: Any,
) -> SharedErrors:
    """As `shared`, from the normal equations of all classes together, (K, p, K, p) and (K, p)."""
    joint = JointEquations.of(matrix, rhs, modes)
    draw, spectra = generator(rng), spectra_of(usual_shapes(modes.lmax) if shapes is None else shapes)
    lots = lots_of(joint.classes, modes, spectra, lambda var: JointBlocks(joint, modes, var, "each"), draws, draw)
    return drawn(lots, modes, draw, **facts)
