"""How the result varies when parts of the sky are left out or drawn again: jackknife and bootstrap over blocks.

Normal equations add, so the sky is cut into blocks once, and every replicate is a sum of blocks that are already there.

If neighbours share errors, blocks must be larger than the correlation length (`compare_blocks` estimates it). Errors
common to the whole sky, above all a glide or a rotation of the frame, cannot be detected by any resampling.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from fit.normal import Moments, NormalEquations, WhiteRows, normal_equations
from fit.resample._bootstrap import Resampled
from fit.solving import solve
from vsh.field import Field
from vsh.io.parts import Parts, as_parts
from vsh.models.covariance import Covariance
from vsh.modes import Modes, as_modes
from vsh.scalars import ScalarField, modes_for
from vsh.sky.pixels import pixels_of
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError
from vsh.tools.logs import logged
from vsh.tools.parallel import progress_bar
from vsh.tools.types import FloatArray, Rng

#: Beyond this, the normal matrices of all blocks are not kept at once. [bytes]
MEMORY = 4 * 2**30


@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts),
    nside=arguments.whole,
    n_replicates=partial(arguments.whole, least=2),
    rng=arguments.seed,
)
def block_bootstrap(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    nside: int,
    n_replicates: int,
    rng: Rng,
    *,
    covariance: Covariance | FloatArray | None = None,
    progress: bool = True,
) -> Resampled:
    """Bootstrap over HEALPix blocks of the sky: errors that allow for correlations between neighbours.

    Parameters
    ----------
    field, modes, n_replicates, rng, covariance, progress
        As for `bootstrap`.
    nside : int
        nside of the HEALPix blocks; blocks without sources are not counted.

    Raises
    ------
    DegeneracyError
        If fewer than two blocks hold sources, or their matrices do not fit into memory.
    """
    modes = modes_for(field, modes)
    rng = generator(rng)
    p, blocks = len(modes), normals_of_blocks(field, modes, nside, progress, covariance)
    if len(blocks) * p * p * 8 > MEMORY:
        raise DegeneracyError(
            f"{len(blocks)} blocks of {p} × {p} do not fit into memory: lower nside from {nside} or lmax from "
            f"{modes.lmax}"
        )
    normals = list(blocks)
    matrices = np.array([normal.matrix.ravel() for normal in normals])
    sides = np.array([normal.rhs for normal in normals])
    total: Any = sum(normals)
    solution = solve(total)
    replicates = np.empty((n_replicates, p))
    for replicate in progress_bar(replicates, words="block bootstrap", shown=progress):
        times = rng.multinomial(len(normals), np.full(len(normals), 1 / len(normals))).astype(float)
        drawn = NormalEquations(modes, (times @ matrices).reshape(p, p), times @ sides, 0.0, total.n_data, total.frame)
        replicate[:] = solve(drawn).coefficients.values
    return Resampled("block bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


@logged("jackknife")
@arguments.accepts(field=arguments.a(Field, ScalarField, Parts), nside=arguments.whole)
def jackknife(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    nside: int,
    *,
    covariance: Covariance | FloatArray | None = None,
    progress: bool = True,
) -> Resampled:
    """Leave out one HEALPix block of the sky after the other.

    Parameters
    ----------
    field : Field, ScalarField or Parts
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    nside : int
        Resolution of the blocks, 58.6°/nside wide: several times the length over which errors are correlated.
        With noise correlated over 10° pulls were 2.1 at nside 4, 1.5 at 2 and 1.3 at 1 (formal errors: 10).
        Take at least twice as many blocks as coefficients: with fewer, errors come out too large.
    covariance : Covariance or (2n, 2n) array, optional
        As for `bootstrap`.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Resampled
        Its covariance is (B − 1)/B Σ (c_b − c̄)(c_b − c̄)ᵀ over the B blocks.

    Raises
    ------
    DegeneracyError
        If fewer than two blocks hold sources, or the fit is degenerate without one of them.
    """
    modes = modes_for(field, modes)
    blocks = normals_of_blocks(field, modes, nside, progress, covariance)
    whole_sky = blocks.rows.normal_equations() if blocks.rows is not None else normal_equations(field, modes)
    replicates = np.empty((len(blocks), len(modes)))
    for replicate, normal in zip(replicates, blocks, strict=True):
        replicate[:] = solve(whole_sky - normal).coefficients.values
    away = replicates - replicates.mean(0)
    scatter = (len(blocks) - 1) / len(blocks) * away.T @ away
    return Resampled("jackknife", solve(whole_sky), replicates, scatter)


class normals_of_blocks:
    """The normal equations of each HEALPix block that holds sources, one after the other."""

    def __init__(
        self,
        field: Field | ScalarField | Parts,
        modes: Modes,
        nside: int,
        progress: bool = True,
        covariance: Any = None,
    ) -> None:
        self.rows = None if covariance is None else WhiteRows.of(cast(Field, field), modes, covariance)
        self.field, self.modes, self.words, self.progress = field, modes, f"blocks, nside {nside}", progress
        if isinstance(field, Parts):
            work = partial(_by_block, modes=modes, nside=nside)
            blocks = field.sum(work, roles=(), words=self.words, progress=progress)
            self.blocks: list[Any] = [blocks[pixel] for pixel in sorted(blocks)]
        else:
            pixel = pixels_of(field.lon, field.lat, nside)
            order = np.argsort(pixel, kind="stable")
            self.blocks = np.split(order, np.flatnonzero(np.diff(pixel[order])) + 1)
        if len(self.blocks) < 2:
            raise DegeneracyError(f"all sources lie in one block of nside {nside}: take a larger nside")

    def __len__(self) -> int:
        return len(self.blocks)

    def __iter__(self) -> Iterator[NormalEquations]:
        for block in progress_bar(self.blocks, words=self.words, shown=self.progress):
            if isinstance(self.field, Parts):
                yield block.normal_equations()
            elif self.rows is not None:
                yield self.rows[block].normal_equations()
            else:
                yield normal_equations(self.field[block], self.modes)


def _by_block(field, modes, nside):
    pixel = pixels_of(field.lon, field.lat, nside)
    return {int(each): Moments.of(field[pixel == each], modes) for each in np.unique(pixel)}


#: Blocks for each coefficient, at least: with fewer, leaving one out nearly undoes some coefficient, and errors
#: grow with the blocks whatever the sources share (2.7 times at degree 5 and 12 blocks, with independent errors).
BLOCKS_PER_COEFFICIENT = 2


class BlockLength(NamedTuple):
    """Jackknife errors of one size of blocks: rms over the formal error of spin and acceleration, and its own error."""

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


def _length(growth, nside):
    formal = np.concatenate([growth.solution.spin.sigma, growth.solution.acceleration.sigma])
    seen = np.concatenate([growth.spin.sigma, growth.acceleration.sigma])
    blocks = len(growth.replicates)
    ratio = float(np.sqrt(np.mean((seen / formal) ** 2)))
    # Six variances of B − 1 degrees of freedom each.
    return BlockLength(nside, 58.6 / nside, blocks, ratio, ratio / np.sqrt(2 * 6 * (blocks - 1)), growth)


def _grows(row, later):
    return later.ratio - row.ratio > 3 * np.hypot(row.ratio_error, later.ratio_error)


def _advice(rows, best):
    table = "; ".join(
        f"nside {r.nside} ({r.degrees:.0f}°, {r.blocks} blocks): {r.ratio:.2f} ± {r.ratio_error:.2f}" for r in rows
    )
    note = f"jackknife errors over formal ones: {table}; taken: nside {best.nside}"
    if best is rows[-1] and len(rows) > 1:
        note += ", the largest blocks: errors still grow with them, and may be larger yet"
    return note + ". No resampling can detect errors common to the whole sky (a glide or a rotation of the frame)"
