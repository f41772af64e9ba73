"""The columns of a field by the names and units of Gaia's archive, and the objects of other packages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

import vsh  # its face: what draws and reads fields knows them itself
from vsh.tools.errors import FrameError
from vsh.tools.types import Axes, FloatArray, Table
from vsh.tools.units import DEGREE, MAS

if TYPE_CHECKING:
    from collections.abc import Callable


class ByColumns:
    """What a field knows by the names of its table: positions in degrees, motions in mas/yr.

    Attributes inside are `lon`, `lat` in radians, `motion` and `sigma` in µas/yr.
    """

    lon: FloatArray
    lat: FloatArray
    motion: FloatArray
    sigma: FloatArray
    redshift: FloatArray | None
    frame: str
    to_table: Callable[[], Table]
    _table: Callable[[], tuple[dict[str, Any], dict[str, str], dict[str, Any]]]

    @property
    def ra(self) -> FloatArray:
        """Right ascension of each source, (n,). [deg]"""
        return self._icrs("ra", self.lon) / DEGREE

    @property
    def dec(self) -> FloatArray:
        """Declination of each source, (n,). [deg]"""
        return self._icrs("dec", self.lat) / DEGREE

    @property
    def pmra(self) -> FloatArray:
        """Proper motion µ_α* of each source, cos δ included, (n,). [mas/yr]"""
        return self._icrs("pmra", self.motion[0]) / MAS

    @property
    def pmdec(self) -> FloatArray:
        """Proper motion µ_δ of each source, (n,). [mas/yr]"""
        return self._icrs("pmdec", self.motion[1]) / MAS

    @property
    def pmra_error(self) -> FloatArray:
        """Standard error of µ_α* of each source, (n,). [mas/yr]"""
        return self._icrs("pmra_error", self.sigma[0]) / MAS

    @property
    def pmdec_error(self) -> FloatArray:
        """Standard error of µ_δ of each source, (n,). [mas/yr]"""
        return self._icrs("pmdec_error", self.sigma[1]) / MAS

    @property
    def z(self) -> FloatArray | None:
        """Another name of `redshift`."""
        return self.redshift

    @property
    def columns(self) -> list[str]:
        """The names of the columns of `to_table`."""
        return list(self._table()[0])

    def _icrs(self, name, values):
        if self.frame != "icrs":
            raise FrameError(f'{name} is of ICRS axes, and this field has {self.frame} ones: use .to_frame("icrs")')
        return np.asarray(values)

    def head(self, n: int = 5) -> Table:
        """The first rows of the table.

        Parameters
        ----------
        n : int
            How many.
        """
        return self.to_table()[:n]

    def to_pandas(self) -> Any:
        """The sources as a pandas DataFrame in the names and units of Gaia's archive."""
        return self.to_table().to_pandas()

    def to_skycoord(self) -> Any:
        """The sources as an astropy SkyCoord with positions and proper motions."""
        from astropy import units
        from astropy.coordinates import SkyCoord

        names = ("ra", "dec") if self.frame == "icrs" else ("l", "b") if self.frame == "galactic" else ("lon", "lat")
        east = f"pm_{names[0]}_cos{names[1]}"
        degrees, motions = (self.lon / DEGREE, self.lat / DEGREE), self.motion / MAS * units.mas / units.yr
        given: dict[str, Any] = {name: angle * units.deg for name, angle in zip(names, degrees, strict=True)}
        given |= {east: motions[0], f"pm_{names[1]}": motions[1]}
        frame = "barycentricmeanecliptic" if self.frame == "ecliptic" else self.frame
        return SkyCoord(**given, frame=frame)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The sources on the sky, on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Sky axes of `vsh.figures.plot.sky_axes`; a new figure unless given.
        """
        return vsh.figures.plot.plot_sources(cast("vsh.Field", self), ax=ax)

    @classmethod
    def read(cls, source: Any, **reading: Any) -> Self:
        """Read a catalogue: `vsh.read_field`.

        Parameters
        ----------
        source : path or table
            As for `vsh.io.catalogue.read_field`.
        **reading
            Its arguments: columns, units, on_bad, frame, where, format.
        """
        field: Any = vsh.read_field(source, **reading)
        return field

    @classmethod
    def from_table(cls, table: Any, **reading: Any) -> Self:
        """The field of a table in memory: astropy, pandas, polars, Arrow.

        Parameters
        ----------
        table : table
            As for `vsh.io.catalogue.read_field`.
        **reading
            Its arguments.
        """
        return cls.read(table, **reading)
