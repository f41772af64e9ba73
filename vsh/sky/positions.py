"""Positions of sources with their errors: what a reference frame is made of."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vsh.sky.frames import check_frame
from vsh.sky.sphere import angles, triad
from vsh.tools.bad_rows import checked_columns
from vsh.tools.errors import FieldError
from vsh.tools.notebook import Frozen
from vsh.tools.types import BoolArray, FloatArray
from vsh.tools.units import UAS

__all__ = ["Positions"]


@dataclass(frozen=True, eq=False, repr=False)
class Positions(Frozen):
    """Positions of n sources.

    Attributes
    ----------
    lon, lat : (n,) arrays
        [rad]
    sigma : (2, n) array
        Standard errors of α cos δ and δ. [µas]
    rho : (n,) array
        Their correlation; zero unless given.
    name : (n,) array of str or None
    motion : (2, n) array or None
        Proper motions µ_α*, µ_δ, to carry positions to another epoch. [µas/yr]
    epoch : float or None
        Epoch of the positions. [Julian year]
    defining : (n,) bool array or None
        Which of them define the axes of the frame.
    frame : str
    notes : tuple of str

    Raises
    ------
    FieldError
        If shapes disagree or a source has no position or no error.
    """

    lon: FloatArray
    lat: FloatArray
    sigma: FloatArray
    rho: FloatArray = None  # type: ignore[assignment]  # zero unless given, an array from then on
    name: np.ndarray | None = None
    motion: FloatArray | None = None
    epoch: float | None = None
    defining: BoolArray | None = None
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_frame(self.frame)
        for column, array in checked_columns(self, ("lat", "sigma", "rho", "motion"), ("name", "defining")).items():
            object.__setattr__(self, column, array)
        super().__post_init__()

    def __len__(self) -> int:
        return self.lon.size

    def __repr__(self) -> str:
        return f"<Positions: {len(self)} sources, {self.frame}>"

    def __getitem__(self, keep: Any) -> Positions:
        """The sources picked by a mask, a slice or indices."""
        picked: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        picked = {k: v[..., keep] if isinstance(v, np.ndarray) else v for k, v in picked.items()}
        return Positions(**picked)

    def at_epoch(self, epoch: float | None) -> Positions:
        """The same sources, moved to `epoch` [Julian year] along straight lines; those without motion stay.

        Raises
        ------
        FieldError
            If the epoch of the positions is not known.
        """
        if self.motion is None or epoch is None or epoch == self.epoch:
            return self
        if self.epoch is None:
            raise FieldError("these positions have motions but no epoch to carry them from")
        p, q, r = triad(self.lon, self.lat)
        east, north = self.motion * (UAS * (epoch - self.epoch))
        lon, lat = angles(r + east * p + north * q)
        picked: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return Positions(**picked | {"lon": lon, "lat": lat, "epoch": epoch})
