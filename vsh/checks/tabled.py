"""Sources with values and errors as a table: what `vsh.catalogue` reads, and what other programs do."""

from __future__ import annotations

from typing import Any, ClassVar

from vsh.checks.types import PathName, Table
from vsh.checks.weighed import Weighed
from vsh.system.writing import table_of, write_table


class Tabled(Weighed):
    """What a noun of sources knows of tables; `_table` gives its columns, their units, and plain facts, all by name."""

    units_shown: ClassVar[dict[str, str]] = {
        "lon": "rad", "lat": "rad", "motion": "µas/yr", "sigma": "µas/yr", "distance": "Mpc", "distance_error": "Mpc",
    }  # fmt: skip

    def _table(self) -> tuple[dict[str, Any], dict[str, str], dict[str, Any]]:
        raise NotImplementedError

    def to_table(self) -> Table:
        """The sources as an astropy Table in the names and units of Gaia's archive."""
        columns, units, facts = self._table()
        return table_of(columns, facts, units)

    def write(self, path: PathName, meta: dict[str, Any] | None = None) -> None:
        """Write the sources as a table, which `vsh.catalogue` reads."""
        write_table(self.to_table(), path, meta)
