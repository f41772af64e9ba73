"""The sources that a referee looks at, with whatever columns may tell the instrument from the sky."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fit.methods import Recommended, degree_for, recommended
from fit.normal import NormalEquations, Template, normal_equations
from fit.robust import Clipped, clip
from fit.solving import fit_field
from vsh.field import Field
from vsh.io import catalogue, tables
from vsh.tools.errors import ConvergenceError, TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray

#: Columns that checks split the sources by, of Gaia's archive and of tables of VLBI: the first that is there.
_COLUMNS = {
    "colour": ("nu_eff_used_in_astrometry", "bp_rp", "pseudocolour", "bp_g"),
    "visibility periods": ("visibility_periods_used", "n_epoch"),
    "transits": ("matched_transits", "astrometric_matched_transits", "astrometric_n_good_obs_al"),
    "scan strength": ("scan_direction_strength_k2",),
    "scan direction": ("scan_direction_mean_k2",),
    "RUWE": ("ruwe",),
    "last epoch": ("mjd_last",),
    "parameters solved": ("astrometric_params", "astrometric_params_solved"),
}
#: The highest degree of the headline: higher ones tell less of degree 1.
_HIGHEST = 7
_KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class Quasars(InNotebook):
    """Sources, clipped, and what is known of each.

    Attributes
    ----------
    field : Field
        Those that stay after clipping.
    columns : dict of str to (n,) array
        Numbers of each, by what they mean; nan where nothing is known.
    names : dict of str to str
        The column of the table that each is.
    label : str
        Where they are from.
    n_clipped : int
        How many were left out.
    whole : Field
        All of them.
    """

    field: Field
    columns: Mapping[str, FloatArray]
    names: Mapping[str, str]
    label: str
    n_clipped: int
    whole: Field

    @classmethod
    def of(cls, field: Field, columns: Mapping[str, Any], names: Mapping[str, str], label: str) -> "Quasars":
        """Clip the sources to the degree they bear.

        Parameters
        ----------
        field : Field
            All sources.
        columns : dict of str to (n,) array
            Numbers of each, by what they mean.
        names : dict of str to str
            The column of the table that each is.
        label : str
            Where they are from.
        """
        clipped = clipped_of(field)
        kept = clipped.kept
        values = {name: np.asarray(each, float)[kept] for name, each in columns.items()}
        return cls(field[kept], values, names, label, clipped.n_clipped, field)

    def column(self, name: str) -> FloatArray:
        """Numbers of a column, (n,).

        Parameters
        ----------
        name : str
            What it means: "colour", say.

        Raises
        ------
        TableError
            If it is not there; it says what it might be called.
        """
        if name not in self.columns or not np.isfinite(self.columns[name]).any():
            wanted = {"redshift": ("redshift", "z", "redshift_qsoc"), "G": ("phot_g_mean_mag",)} | _COLUMNS
            raise TableError(f"no column of {name} ({', '.join(wanted[name])})")
        return self.columns[name]

    @property
    def degree(self) -> int:
        """The degree that what sources share is looked for to."""
        return degree_for(len(self.field), _HIGHEST)

    @cached_property
    def normal(self) -> NormalEquations:
        """Normal equations of all that stay, to `degree`."""
        return normal_equations(self.field, self.degree)

    @cached_property
    def recommended(self) -> Recommended:
        """The recommended fit of all sources, none clipped."""
        return recommended(self.whole)

    @property
    def is_scaled(self) -> bool:
        """Whether χ² scales the errors of `equations`: not where a robust fit has settled."""
        return self.recommended.weights is None

    def equations(self, chosen: Any, lmax: int, *, templates: Sequence[Template] = ()) -> NormalEquations:
        """Sum those `chosen` to degree `lmax`, with `templates`, by the weights of the recommended fit."""
        return self.recommended.equations(self.field[chosen], lmax, templates=templates)

    def plain_equations(self, chosen: Any, lmax: int) -> NormalEquations:
        """Sum those `chosen` to degree `lmax` by the errors quoted, as published analyses do."""
        return normal_equations(self.field[chosen], lmax)


def clipped_of(field: Field) -> Clipped:
    """Clip at κ = 3 to degree 3, or what few sources bear; where that oscillates, at the limit of a first fit."""
    lmax = degree_for(len(field), 3)
    try:
        return clip(field, lmax, _KAPPA)
    except ConvergenceError:
        white = fit_field(field, lmax).residuals(field).whitened
        return clip(field, lmax, threshold=_KAPPA * float(np.median(np.sqrt(np.sum(white**2, 0)))))


def read_quasars(source: Any, *, axes: str = "icrs", **reading: Any) -> Quasars:
    """Read what a referee looks at.

    Parameters
    ----------
    source : path or table
        As for `vsh.io.catalogue.read_field`.
    axes : str
        Those of all results: "icrs", "galactic" or "ecliptic".
    **reading
        Its arguments: columns, units, on_bad, frame, where, format.

    Returns
    -------
    Quasars
        Clipped at κ = 3; columns that are not there are left out.

    Raises
    ------
    TableError
        If a column that is needed is missing.
    FieldError
        If no source, or not every one, can be used.
    DegeneracyError
        If there are fewer than a dozen.
    """
    opened = tables.open_table(source, reading.pop("format", None))
    field = catalogue.read_field(opened, **reading, roles=("name", "redshift", "magnitude")).to_frame(axes)
    names = {
        meaning: next(each for each in candidates if each in opened.names)
        for meaning, candidates in _COLUMNS.items()
        if any(each in opened.names for each in candidates)
    }
    read = catalogue.read_columns(opened, names.values(), **reading)
    columns = {meaning: read[name] for meaning, name in names.items()}
    for meaning, values in (("redshift", field.redshift), ("G", field.magnitude)):
        if values is not None:
            columns[meaning] = np.asarray(values, float)
    return Quasars.of(field, columns, names, opened.label)
