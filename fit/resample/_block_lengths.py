"""How long the blocks of a jackknife must be: several lengths side by side."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from fit.resample._blocks import jackknife
from vsh.checks import arguments
from vsh.errors import DegeneracyError
from vsh.field import Field
from vsh.modes import Modes, as_modes
from vsh.parts import Parts, as_parts
from vsh.sky.pixels import pixels_of

#: Blocks for each coefficient, at least: with fewer, leaving one out nearly undoes some coefficient, and errors
#: grow with the blocks whatever the sources share (2.7 times at degree 5 and 12 blocks, with independent errors).
BLOCKS_PER_COEFFICIENT = 2


class BlockLength(NamedTuple):
    """Jackknife errors with one size of blocks.

    `ratio` is the rms error over the formal one, of spin and acceleration together; `ratio_error` its own
    standard error, as blocks are few.
    """

    nside: int
    degrees: float
    blocks: int
    ratio: float
    ratio_error: float
    resampled: object


@arguments.accepts(field=arguments.a(Field, Parts))
def compare_blocks(
    field: Field | Parts, modes: Modes | int, *, nsides: Sequence[int] = (8, 4, 2, 1), progress: bool = True
) -> tuple[list[BlockLength], BlockLength, str]:
    """Jackknife errors with blocks of several sizes, side by side: which are long enough?

    If errors of neighbouring sources are correlated, jackknife errors grow with the size of the blocks, until blocks
    are larger than the correlation length.

    Parameters
    ----------
    field : Field or Parts
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    nsides : tuple of int
        From small blocks to large ones.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    rows : list of BlockLength
        One for each size with at least twice as many blocks as coefficients, and without any one of which
        the fit stays determined.
    best : BlockLength
        The smallest blocks beyond which the errors do not grow significantly.
    advice : str
        In words, with what no resampling can see.

    Raises
    ------
    DegeneracyError
        If no size can be used.
    """
    modes = as_modes(modes)
    needed, rows, failed = BLOCKS_PER_COEFFICIENT * len(modes), [], None
    for nside in nsides:
        blocks = len(as_parts(field).sum(partial(_pixels, nside=nside), roles=(), words="blocks"))
        if blocks < needed:
            failed = DegeneracyError(
                f"{blocks} blocks of nside {nside} are too few for {len(modes)} coefficients; "
                f"{needed} are needed: fit a lower degree, or take smaller blocks"
            )
            continue
        try:
            rows.append(_length(jackknife(field, modes, nside, progress=progress), nside))
        except DegeneracyError as error:
            failed = error
    if not rows:
        raise failed or DegeneracyError("no sizes of blocks were given")
    best = next(row for i, row in enumerate(rows) if all(not _grows(row, later) for later in rows[i + 1 :]))
    return rows, best, _advice(rows, best)


def _pixels(field, nside):
    """The blocks that hold sources, as keys."""
    return dict.fromkeys(np.unique(pixels_of(field.lon, field.lat, nside)).tolist())


def _length(found, nside):
    formal = np.concatenate([found.solution.spin.sigma, found.solution.acceleration.sigma])
    seen = np.concatenate([found.spin.sigma, found.acceleration.sigma])
    blocks = len(found.replicates)
    ratio = float(np.sqrt(np.mean((seen / formal) ** 2)))
    # Six variances of B − 1 degrees of freedom each.
    return BlockLength(nside, 58.6 / nside, blocks, ratio, ratio / np.sqrt(2 * 6 * (blocks - 1)), found)


def _grows(row, later):
    return later.ratio - row.ratio > 3 * np.hypot(row.ratio_error, later.ratio_error)


def _advice(rows, best):
    table = "; ".join(
        f"nside {r.nside} ({r.degrees:.0f}°, {r.blocks} blocks): {r.ratio:.2f} ± {r.ratio_error:.2f}" for r in rows
    )
    said = f"jackknife errors over formal ones: {table}; taken: nside {best.nside}"
    if best is rows[-1] and len(rows) > 1:
        said += ", the largest blocks: errors still grow with them, and may be larger yet"
    return said + ". No resampling can detect errors common to the whole sky (a glide or a rotation of the frame)"
