"""Files of epoch astrometry, in the columns of the draft of Gaia DR4's data model, as fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vsh.archive import DR4
from vsh.checks.types import OnBad
from vsh.checks.validation import select_usable
from vsh.epochs._observations import read_observations
from vsh.epochs._solve import solve_epochs
from vsh.field import Field


def read_epochs(
    source: Any,
    *,
    epoch: float = DR4.epoch,
    robust: bool = True,
    on_bad: OnBad = "raise",
    columns: Mapping[str, str] | None = None,
) -> Field:
    """Solve for five parameters of every source of a table of epoch astrometry.

    Parameters
    ----------
    source : path or table
        A row a transit with arrays of its CCDs (FITS), or a row an observation (any format): source_id,
        obs_time_tcb [ns since J2010.0], centroid_pos_al and its error [mas], scan_pos_angle [deg],
        parallax_factor_al, ra0 and dec0 [deg]; obs_time_bary_corr [ns] and used_by_agis_al where they are.
    epoch : float
        Of the positions; motions hardly depend on it. [Julian year, TCB]
    robust : bool
        Downweight outliers and estimate an excess noise of each source, as AGIS does.
    on_bad : {"raise", "drop"}
        What to do about sources without a solution.
    columns : dict of str to str, optional
        Other names of these columns.

    Returns
    -------
    Field
        Motions with their formal errors; its notes count observations that were not used.

    Raises
    ------
    TableError
        If a column is missing or holds no numbers.
    FieldError
        If a source has too few observations, or all in one direction.

    Notes
    -----
    The colour of a source is taken as known: DR4's own solutions have a pseudocolour besides.
    """
    found = read_observations(source, epoch=epoch, columns=columns)
    solution = solve_epochs(found.source, found.design, found.position, found.error, robust=robust)
    lon, lat, notes = found.lon, found.lat, found.notes
    lost = {"fewer than six observations": solution.observations <= 5}
    lost["scans in too few directions"] = ~solution.solved & ~lost["fewer than six observations"]
    keep, said = select_usable(
        {reason: mask for reason, mask in lost.items() if mask.any()}, len(lon), on_bad, 0, (lon, lat)
    )
    covariance = solution.covariance[keep][:, 3:, 3:]
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    share = 100 * solution.outliers.sum() / max(1, solution.observations.sum())
    if robust:
        notes = (*notes, f"epochs: {share:.2g} % of {solution.observations.sum()} observations have a weight below 0.2")
    return Field(
        lon[keep], lat[keep], solution.values[keep][:, 3:].T, sigma, covariance[:, 0, 1] / (sigma[0] * sigma[1]),
        name=found.name[keep], notes=(*notes, *said),
    )  # fmt: skip
