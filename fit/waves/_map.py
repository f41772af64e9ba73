"""2F over a map of directions, from whitened coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from fit.quality import printed_p_value
from vsh.models.waves import wave_templates
from vsh.modes import Modes
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError
from vsh.tools.notebook import Frozen
from vsh.tools.types import BoolArray, FloatArray, Rng


@dataclass(frozen=True, eq=False)
class Whitened(Frozen):
    """Equations of unit noise for some coefficients, all others free."""

    kept: BoolArray
    root: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray, rhs: FloatArray, kept: BoolArray) -> Whitened:
        """From normal equations."""
        try:
            free = cho_factor(matrix[np.ix_(~kept, ~kept)])
            across = matrix[np.ix_(~kept, kept)]
            reduced = matrix[np.ix_(kept, kept)] - across.T @ cho_solve(free, across)
            root = cholesky(reduced)
        except np.linalg.LinAlgError:
            raise DegeneracyError(
                f"these sources do not determine {len(kept)} coefficients: lower lmax, or take more of the sky"
            ) from None
        values = solve_triangular(root, rhs[kept] - across.T @ cho_solve(free, rhs[~kept]), trans="T")
        return cls(kept, root, values)


@lru_cache(maxsize=4)
def templates(lmax: int, nside: int) -> FloatArray:
    """Coefficients of both polarisations for every pixel, (2, p, 12 nside²)."""
    templates = wave_templates(triad(*centres(nside))[2], lmax)
    templates.flags.writeable = False
    return templates


def map_of(white: Whitened, modes: Modes, nside: int, copies: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """2F, the best amplitudes, (2 copies, n), and their covariance, (n, 2 copies, 2 copies), for every direction."""
    seen, inverse = _basis(white, modes, nside, copies)
    g = np.tensordot(white.values, seen, axes=(0, 1))
    amplitudes = np.einsum("nij,jn->in", inverse, g)
    return np.sum(g * amplitudes, axis=0), amplitudes, inverse


def _basis(white, modes, nside, copies):
    """Whitened templates, (2 copies, q, n), and the inverse of their products, (n, 2 copies, 2 copies)."""
    single = templates(modes.lmax, nside)
    p = len(modes)
    whole = np.zeros((2 * copies, copies * p, single.shape[2]))
    for copy in range(copies):
        whole[2 * copy : 2 * copy + 2, copy * p : (copy + 1) * p] = single
    seen = np.tensordot(white.root, whole[:, white.kept], axes=(1, 1)).transpose(1, 0, 2)
    return seen, np.linalg.inv(np.einsum("iqn,jqn->nij", seen, seen))


def chance(white: Whitened, modes: Modes, nside: int, largest: float, n_skies: int, rng: Rng) -> float:
    """Probability that noise alone gives as large a 2F anywhere."""
    return share_beyond(chances(white, modes, nside, n_skies, rng), largest)


def share_beyond(maxima: FloatArray, largest: float) -> float:
    """(1 + how many of the skies reach the largest)/(1 + how many there are)."""
    return (1 + int(np.sum(maxima >= largest))) / (1 + len(maxima))


def chances(white: Whitened, modes: Modes, nside: int, n_skies: int, rng: Rng, copies: int = 1) -> FloatArray:
    """The largest 2F of each of so many skies of noise."""
    seen, inverse = _basis(white, modes, nside, copies)
    root = np.linalg.cholesky(inverse)
    rotated = np.einsum("nij,iqn->jnq", root, seen)  # 2F is the sum of squares of these with the noise
    rng, largest = generator(rng), []
    for start in range(0, n_skies, 100):
        noise = rng.standard_normal((len(white.values), min(100, n_skies - start)))
        largest.append(sum((part @ noise) ** 2 for part in rotated).max(axis=0))
    return np.concatenate(largest)


def p_in_words(p_value: float, n_skies: int) -> str:
    """A p-value of so many simulated skies as it is printed: "at most" where none of them had as much."""
    return "at most " * (p_value * (1 + n_skies) < 1.5) + printed_p_value(p_value)
