"""The frame rotator that ends a solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.agis.results._solution import AgisSolution
from vsh.checks import arguments, arrays
from vsh.checks.types import ArrayLike, FloatArray
from vsh.errors import ParameterError
from vsh.sky.sphere import triad


def rotate_frame(
    solution: AgisSolution,
    vlbi: ArrayLike,
    quasars: ArrayLike | None = None,
    *,
    radio: float = 100.0,
    own: float = 10.0,
    rng: Any = None,
) -> tuple[AgisSolution, FloatArray, FloatArray]:
    """The frame rotator that ends a solution: ε₀ from radio positions, ω with a glide from motions of quasars.

    As Bachchan, Hobbs & Lindegren (2016, section 4): positions of VLBI quasars are known with an error, motions of quasars
    are zero but for a glide and a scatter of their own.

    Parameters
    ----------
    solution : AgisSolution
        Whose frame is arbitrary.
    vlbi, quasars : indices or masks
        Sources with radio positions; whose motions count (all unless given).
    radio, own : float
        Errors of a radio position, and scatter of true motions, in each component. [µas, µas/yr]
    rng : Generator or int, optional
        Draws the radio positions' errors; none unless given.

    Returns
    -------
    solution : AgisSolution
        In the rotated frame.
    rotation, errors : (6,) arrays
        ε₀ and ω that were taken away, and their formal errors.

    Raises
    ------
    ParameterError
        If fewer than two sources determine either.
    """
    arguments.a(AgisSolution)("solution", solution)
    found, sigma = [], []
    n = len(solution.lon)
    chosen = arrays.indices("vlbi", vlbi, n), arrays.indices("quasars", quasars, n)
    for columns, which, spread in zip((slice(0, 2), slice(3, 5)), chosen, (radio, own), strict=True):
        which = which[solution.solved[which]]
        if len(which) < 3:
            raise ParameterError(f"a frame rotator needs three solved sources of each kind, not {len(which)}")
        spread = arguments.not_negative("radio or own", spread)
        p, q, _ = triad(solution.lon[which], solution.lat[which])
        design = [np.stack([q, -p], axis=1)]  # (3, 2, m)
        if columns.start:
            design.append(np.stack([p, q], axis=1))  # a glide g: g·p east, g·q north
        rows = np.concatenate(design)
        motion = solution.sources[which][:, columns].T
        if columns.start == 0 and rng is not None:
            motion = motion - spread * arguments.generator(rng).standard_normal(motion.shape)
        weights = np.linalg.inv(solution.formal[which][:, columns, columns] + spread**2 * np.eye(2))
        weighted = np.einsum("nij,pjn->pin", weights, rows)
        covariance = np.linalg.inv(np.einsum("pin,qin->pq", weighted, rows))
        found.append((covariance @ np.einsum("pin,in->p", weighted, motion))[:3])
        sigma.append(np.sqrt(np.diag(covariance))[:3])
    words = f"frame rotated: ε₀ = {np.round(found[0], 2).tolist()} µas, ω = {np.round(found[1], 3).tolist()} µas/yr taken away"
    return solution.rotated(found[0], found[1], words), np.concatenate(found), np.concatenate(sigma)
