"""Draws of what classes share, for each shape of the spectrum, and what is kept of them."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from fit.background._blocks import Blocks, ClassEquations
from fit.background._floor import shape_probabilities
from vsh.models.covariance import Spectrum
from vsh.modes import Modes
from vsh.tools.parallel import blas_for
from vsh.tools.types import FloatArray

#: Draws that count fewer than this are drawn again, four times as many, up to a limit.
EFFECTIVE = 20.0
#: So many draws of equal weight are kept.
_KEPT = 60


class Lot(NamedTuple):
    """Draws of the amplitudes of one shape: shares times `scale` times the spectrum's variances are powers."""

    shape: str
    spectrum: Spectrum
    probability: float
    blocks: Blocks
    scale: float
    x: FloatArray
    weight: FloatArray

    @property
    def effective(self) -> float:
        """How many of the draws count."""
        return float(1 / np.sum(self.weight**2))


def lots_of(
    classes: Sequence[ClassEquations],
    modes: Modes,
    spectra: Sequence[tuple[str, Spectrum]],
    blocks_of: Callable[[FloatArray], Blocks],
    draws: int,
    rng: np.random.Generator,
) -> list[Lot]:
    """Draws of the amplitudes for each shape, again where too few of them count; `blocks_of` variances of a shape."""
    high = modes.degrees > 1
    squares: Any = sum(each.matrix**2 for each in classes)
    flat = Spectrum.flat().variances(modes)[high]
    squares = squares[: len(flat), : len(flat)]  # without templates
    lots, evidences = [], []
    with blas_for(len(classes) * len(modes)):
        for name, spectrum in spectra:
            variances = spectrum.variances(modes)
            # All shapes as well seen as the flat one, or their evidence would depend on units.
            scale = np.sqrt((flat @ squares @ flat) / (variances[high] @ squares @ variances[high]))
            blocks = blocks_of(variances * scale)
            x, weight, evidence = blocks.sample(draws, rng, EFFECTIVE)
            lots.append(Lot(name, spectrum, np.nan, blocks, float(scale), x, weight))
            evidences.append(evidence)
    probability = shape_probabilities([name for name, _ in spectra], evidences)
    return [lot._replace(probability=float(p)) for lot, p in zip(lots, probability, strict=True)]


def kept_of(lots: Sequence[Lot], rng: np.random.Generator) -> tuple[Any, Any, Any, Any]:
    """Draws of equal weight by systematic resampling: degree 1, its covariance, C by the flat one, templates."""
    weight = np.concatenate([lot.probability * lot.weight for lot in lots])
    where = [(lot, i) for lot in lots for i in range(len(lot.x))]
    at = (np.arange(_KEPT) + rng.random()) / _KEPT
    chosen = np.minimum(np.searchsorted(np.cumsum(weight) / weight.sum(), at), len(weight) - 1)
    done: dict[int, Any] = {}
    for k in chosen:
        if k not in done:
            lot, i = where[k]
            power = lot.blocks.first.reshape(2, 3).mean(1)[[0, 1]]
            unit = Spectrum.flat().variances(Modes(1)).reshape(2, 3).mean(1)
            shares = lot.blocks.shares(lot.x[i])[:2] * (power / unit)[:, None, None]
            done[k] = (*lot.blocks.degree_one(lot.x[i]), shares, *lot.blocks.template_amplitudes(lot.x[i]))
    means, covariances, shares, values, spreads = (np.array([done[k][part] for k in chosen]) for part in range(5))
    away = values - values.mean(0)
    return means, covariances, shares, (values.mean(0), spreads.mean(0) + away.T @ away / len(away))
