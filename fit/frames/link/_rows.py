"""The rows of a link: what several catalogues tell of frames whatever the true parameters of the sources are.

Frames are turned by orientation and spin, in steps and powers of magnitude (`Unknowns`); what is known of
them from elsewhere (binaries, clusters, quasars) is a `LinkPrior`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vsh.classes import Classes
from vsh.io import tables
from vsh.io.columns import missing_column, unit_factor
from vsh.sky.astrometry import AstrometryRows, earth, propagate
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.arguments import choice, covariance, float_array
from vsh.tools.bad_rows import as_floats_and_mask
from vsh.tools.errors import DegeneracyError, FieldError, ParameterError, TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import one_line_text
from vsh.tools.types import ArrayLike, FloatArray, IntArray
from vsh.tools.units import AU_PER_YEAR, UAS
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class LinkPrior(InNotebook):
    """Orientation or spin of a catalogue at a magnitude, from elsewhere.

    Attributes
    ----------
    vector : str
        "orientation", "spin" or "acceleration".
    value : (3,) array
        [µas or µas/yr]
    covariance : (3, 3) array
    magnitude : float, optional
        That of the sources it is from; needed where the frame changes with magnitude.
    catalogue : str, optional
        Whose; of the one that is turned unless given.
    """

    vector: str
    value: FloatArray
    covariance: FloatArray = field(repr=False)
    magnitude: float | None = None
    catalogue: str | None = None

    def __post_init__(self) -> None:
        """Check what a caller may have mixed up."""
        choice("vector", self.vector, tuple(VECTORS))
        object.__setattr__(self, "value", float_array("the value of a prior", self.value, (3,)))
        object.__setattr__(self, "covariance", covariance("the covariance of a prior", self.covariance, 3))


def read_priors(source: Any, magnitude: float | None = None) -> list[LinkPrior]:
    """Read priors from a table, a row each, or from the results of `vsh-fit`.

    Parameters
    ----------
    source : path, or table
        Columns `x`, `y`, `z`, `x_error` …, and where known `x_y_corr`, `x_z_corr`, `y_z_corr`, `vector` ("spin" unless
        given), `magnitude`, `catalogue`; in µas and µas/yr where the table does not say. Or the folder that
        `vsh-fit --output` wrote, or its `vectors.ecsv`: the spin of the motions of its sources, turned to ICRS axes.
    magnitude : float, optional
        Magnitude of all priors for which the table has none; of the results of a fit 20, as of quasars, unless given.

    Raises
    ------
    TableError
        If a column is missing.
    ParameterError
        If a row has an error that is none.
    """
    if isinstance(source, str | PathLike) and Path(source, _FIT_VECTORS_FILE).is_file():
        source = Path(source, _FIT_VECTORS_FILE)
    table = tables.open_table(source)
    if {"x", "sigma_x", "name"} <= {*table.names}:
        return _read_fit_spin(table, magnitude)
    for name in (*"xyz", *(f"{axis}_error" for axis in "xyz")):
        if name not in table.names:
            raise TableError(f"{table.label}: {missing_column(name, table)}")
    numbers = {name: _read_number_column(table, name) for name in table.names if name in _NUMBERS}
    texts = {name: np.asarray(table.columns((name,))[name][0]).astype(str) for name in _TEXTS if name in table.names}
    n_rows, priors = len(numbers["x"]), []
    vectors, catalogues = texts.get("vector", ["spin"] * n_rows), texts.get("catalogue", [None] * n_rows)
    for row, (vector, catalogue) in enumerate(zip(vectors, catalogues, strict=True)):
        unit = "uas" if vector == "orientation" else "uas / yr"

        def read_number(name, row=row, unit=unit):
            factor = unit_factor(name, table.units.get(name), unit) if name[:1] in "xyz" and "corr" not in name else 1.0
            return float(numbers[name][row]) * factor if name in numbers else 0.0

        errors = np.array([read_number(f"{axis}_error") for axis in "xyz"])
        correlation = np.eye(3)
        for name, (i, j) in {"x_y_corr": (0, 1), "x_z_corr": (0, 2), "y_z_corr": (1, 2)}.items():
            correlation[i, j] = correlation[j, i] = read_number(name)
        entry = read_number("magnitude") if "magnitude" in numbers else np.nan
        row_magnitude, label = entry if np.isfinite(entry) else magnitude, None if catalogue is None else str(catalogue)
        value = np.array([read_number(axis) for axis in "xyz"])
        priors.append(LinkPrior(str(vector), value, correlation * np.outer(errors, errors), row_magnitude, label))
    return priors


def _read_fit_spin(table, magnitude):
    """Read the spin of a fit to motions as a prior, from the table of its vectors."""
    vector_names = np.asarray(table.columns(("name",))["name"][0]).astype(str)
    if "spin" not in vector_names:
        raise TableError(f"{table.label}: no row is called spin; there are {', '.join(vector_names)}")
    row = int(np.flatnonzero(vector_names == "spin")[0])

    def read_number(name):
        return float(_read_number_column(table, name)[row])

    if any(unit_factor(axis, table.units.get(axis), "uas / yr") != 1 for axis in "xyz"):
        raise TableError(f"{table.label}: the spin is not in µas/yr")
    matrix = np.diag([read_number(f"sigma_{axis}") ** 2 for axis in "xyz"])
    for name, (i, j) in {"cov_xy": (0, 1), "cov_xz": (0, 2), "cov_yz": (1, 2)}.items():
        matrix[i, j] = matrix[j, i] = read_number(name)
    frame = table.meta.get("frame", "icrs")
    if "frame" in table.names:  # a format without metadata says it there
        frame = np.asarray(table.columns(("frame",))["frame"][0]).astype(str)[row]
    turn = rotation_matrix(str(frame), "icrs")
    value = turn @ np.array([read_number(axis) for axis in "xyz"])
    return [LinkPrior("spin", value, turn @ matrix @ turn.T, magnitude=_QUASARS if magnitude is None else magnitude)]


#: The table of a fit's spin and acceleration, in its folder of results.
_FIT_VECTORS_FILE = "vectors.ecsv"
#: Magnitude of quasars, whose frame may be another one than that of the stars of a link. [G]
_QUASARS = 20.0
_NUMBERS = (*"xyz", *(f"{axis}_error" for axis in "xyz"), "x_y_corr", "x_z_corr", "y_z_corr", "magnitude")
_TEXTS = ("vector", "catalogue")


def _read_number_column(table, name):
    """Read a column as numbers, nan where nothing is."""
    values, mask = table.columns((name,))[name]
    floats, is_missing = as_floats_and_mask(name, values)
    return np.where(is_missing if mask is None else is_missing | np.asarray(mask, bool), np.nan, floats)


_AXES = "xyz"
#: Vectors that can be unknown: their names, and the unit of each.
VECTORS = {"orientation": ("epsilon", "µas"), "spin": ("omega", "µas/yr"), "acceleration": ("a", "µas/yr")}
#: Magnitude from which powers are counted.
_ZERO_MAGNITUDE = 13.0


@dataclass(frozen=True)
class Unknowns(InNotebook):
    """Unknowns of a link: its vectors, and how they change with magnitude.

    Attributes
    ----------
    vectors : tuple of str
        Some of "orientation", "spin" and "acceleration". The acceleration is that of the Solar System: one for all.
    turned : tuple of str
        The catalogues that are turned against the reference.
    steps : tuple of float
        Magnitudes from which on (fainter) a frame is turned by so much more.
    order : int
        Powers of (G − 13 mag), each.
    epoch : float
        The epoch of the orientation. [Julian year]
    has_parallax_terms : bool
        Whether the parallaxes of each catalogue have a zero point and a scale relative to the reference.
    """

    vectors: tuple[str, ...]
    turned: tuple[str, ...]
    steps: tuple[float, ...] = ()
    order: int = 0
    epoch: float = 2016.0
    has_parallax_terms: bool = False

    def __post_init__(self) -> None:
        """Check what a caller may have mixed up."""
        unknown_vectors = [vector for vector in self.vectors if vector not in VECTORS]
        if unknown_vectors or not self.vectors:
            raise ParameterError(
                f"unknowns are of {', '.join(VECTORS)}, parallax, not {', '.join(map(str, unknown_vectors)) or 'none'}"
            )
        if len(set(self.steps)) < len(self.steps) or not np.isfinite(self.steps).all():
            raise ParameterError(f"steps are different magnitudes, not {self.steps}")

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the functions of magnitude; that of the constant is empty."""
        return ("", *(f" at {step:g}" for step in self.steps), *(f"[(G-13)^{k}]" for k in range(1, self.order + 1)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, that of a catalogue before them where several are turned."""
        return tuple(name for name, _ in self._iterate_parameters())

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters, empty for a scale."""
        return tuple(unit for _, unit in self._iterate_parameters())

    def _iterate_parameters(self):
        """Iterate over name and unit of each parameter, in their order."""
        for catalogue in self.turned:
            prefix = self._make_catalogue_prefix(catalogue)
            for vector in self.vectors:
                if vector != "acceleration":
                    for term in self.terms:
                        yield from ((_name_parameter(prefix, vector, axis, term), VECTORS[vector][1]) for axis in _AXES)
        for catalogue in self.turned:
            yield from zip(self.parallax_names(catalogue), ("µas", ""), strict=False)
        if "acceleration" in self.vectors:
            yield from ((_name_parameter("", "acceleration", axis, ""), VECTORS["acceleration"][1]) for axis in _AXES)

    def _make_catalogue_prefix(self, catalogue):
        """Make the prefix of the names of a catalogue's parameters."""
        return f"{catalogue}:" if len(self.turned) > 1 else ""

    def parallax_names(self, catalogue: str) -> tuple[str, ...]:
        """Names of zero point and scale of the parallaxes of a `catalogue`; none if they are not unknown."""
        prefix = self._make_catalogue_prefix(catalogue)
        return (f"{prefix}parallax_zero", f"{prefix}parallax_scale") if self.has_parallax_terms else ()

    @property
    def levels(self) -> tuple[tuple[str, float | None], ...]:
        """Ranges of magnitude between the steps, in words, each with a magnitude within it."""
        edges = sorted(self.steps)
        if not edges:
            return (("", None),)
        return tuple(zip(Classes.by_edges("G", edges).labels, [np.nextafter(edges[0], -np.inf), *edges], strict=True))

    def functions(self, magnitude: ArrayLike) -> FloatArray:
        """The functions of `terms` at each `magnitude`, (k, n); nan where that is not known."""
        magnitude = np.atleast_1d(np.asarray(magnitude, float))
        missing_as_nan = np.where(np.isnan(magnitude), np.nan, 0.0)
        function_values = [np.ones(magnitude.shape), *((magnitude >= step) + missing_as_nan for step in self.steps)]
        function_values += [(magnitude - _ZERO_MAGNITUDE) ** k for k in range(1, self.order + 1)]
        return np.array(function_values)

    def jump(self, vector: str, catalogue: str, step: float) -> FloatArray:
        """Linear combination of the parameters for the jump of a `vector` of one `catalogue` at a `step`, (3, p)."""
        at_step = self.combination(vector, catalogue, step)
        return at_step - self.combination(vector, catalogue, np.nextafter(step, -np.inf))

    def combination(self, vector: str, catalogue: str, magnitude: float | None = None) -> FloatArray:
        """Linear combination of the parameters for a vector of one catalogue at a magnitude, (3, p).

        Without a magnitude it is that of the brightest sources, before all steps and without powers.

        Parameters
        ----------
        vector : str
            "orientation", "spin" or "acceleration".
        catalogue : str
            The one that is turned.
        magnitude : float, optional
            Where.
        """
        function_values = self.functions(np.nan if magnitude is None else magnitude)[:, 0]
        if magnitude is None:
            function_values = np.where(np.isnan(function_values), 0.0, function_values)
        names = self.names
        prefix = self._make_catalogue_prefix(catalogue)
        matrix = np.zeros((3, len(names)))
        terms = self.terms if vector != "acceleration" else ("",)
        for k, axis in enumerate(_AXES):
            for term, value in zip(terms, function_values, strict=False):
                name = _name_parameter("" if vector == "acceleration" else prefix, vector, axis, term)
                matrix[k, names.index(name)] = value
        return matrix

    def design(
        self, lon: FloatArray, lat: FloatArray, epoch: FloatArray, functions: FloatArray, catalogue: str
    ) -> FloatArray:
        """Derivatives of Δα*, Δδ, ϖ, µ_α*, µ_δ by the parameters of the frame, for rows of one catalogue, (n, 5, p).

        The frame turns what it gives by ε + ω (t − epoch) (`fit.direct`): Δα* = q·ε, Δδ = −p·ε.

        Parameters
        ----------
        lon, lat, epoch : (n,) arrays
            Places [rad] and epochs of the rows. [Julian year]
        functions : (k, n) array
            The functions of `terms` there.
        catalogue : str
            The one that they are of.
        """
        n, names = len(lon), self.names
        design = np.zeros((n, 5, len(names)))
        if catalogue not in self.turned:
            return design
        p, q, _ = triad(lon, lat)
        rotation = np.stack([q.T, -p.T], 1)  # (n, 2, 3)
        start = self.turned.index(catalogue) * sum(3 * len(self.terms) for v in self.vectors if v != "acceleration")
        for vector in self.vectors:
            if vector == "acceleration":
                continue
            for term_values in functions:
                columns = slice(start, start + 3)
                if vector == "orientation":
                    design[:, :2, columns] = term_values[:, None, None] * rotation
                else:
                    design[:, :2, columns] = (term_values * (epoch - self.epoch))[:, None, None] * rotation
                    design[:, 3:, columns] = term_values[:, None, None] * rotation
                start += 3
        return design


def _name_parameter(prefix, vector, axis, term):
    """Name a parameter: what a step adds is a jump, not the value beyond it."""
    component = f"{prefix}{VECTORS[vector][0]}_{axis}{term}"
    return f"jump {component}" if term.startswith(" at ") else component


#: Singular values of a source's whitened equations below so much of the largest are none.
_RANK_LIMIT = 1e-9
#: Positions farther from what was expected than so much are of another source. [rad]
_LARGEST_OFFSET = np.radians(1 / 60)
#: Sources that are eliminated together.
_CHUNK_SIZE = 4096


@dataclass(frozen=True, eq=False)
class WhitenedDifferences:
    """Differences that hold no true parameter, of unit variance and independent of each other.

    Attributes
    ----------
    design, rhs : (m, p) and (m,) arrays
        rhs = design · x + noise.
    source : (m,) int array
        The source of each.
    names : tuple of str
        The sources that tell anything.
    magnitude : (n,) array
    rows : (n,) int array
        How many rows of the catalogues each source has.
    log_determinant : float
        Half of that of the covariances of the differences: what unit variance leaves out of a likelihood.
    """

    design: FloatArray
    rhs: FloatArray
    source: IntArray
    names: tuple[str, ...]
    magnitude: FloatArray
    rows: IntArray
    log_determinant: float

    @cached_property
    def dims(self) -> IntArray:
        """Number of differences per source."""
        return np.bincount(self.source, minlength=len(self.names))

    @property
    def source_slices(self) -> list[slice]:
        """Slices of the differences of each source: they stand together."""
        ends = np.cumsum(self.dims)
        return [slice(end - size, end) for end, size in zip(ends.tolist(), self.dims.tolist(), strict=True)]


class _GroupDifferences(NamedTuple):
    """Data that one group leaves: its number, differences of unit variance, and half of ln of the determinant."""

    group: int
    design: FloatArray
    rhs: FloatArray
    log_determinant: float


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of every row, before true parameters are eliminated.

    Attributes
    ----------
    rows : tuple of (j, ) int arrays
        The rows of the astrometry that each source has, or all sources of one calibrator together.
    residual : (n, 5), design : (n, 5, p), truth : (n, 5, 5) arrays
        For each row: measured less expected, and derivatives by the frame and by the source's true parameters.
    data : AstrometryRows
    """

    rows: tuple[IntArray, ...]
    residual: FloatArray
    design: FloatArray
    truth: FloatArray
    data: AstrometryRows

    @cached_property
    def source(self) -> IntArray:
        """The number of each row's source."""
        return self.data.source

    @property
    def n_matched(self) -> int:
        """The number of sources in two catalogues or more."""
        source_catalogue_pairs = np.unique(
            np.stack([self.source, np.unique(self.data.catalogue, return_inverse=True)[1].ravel()]), axis=1
        )
        return int((np.bincount(source_catalogue_pairs[0]) > 1).sum())

    def describe_matching(self) -> str:
        """Say by what sources are matched, with the first name of each catalogue."""
        first_names = {label: self.data.name[self.data.catalogue == label][0] for label in self.data.catalogues}
        listed_names = ", ".join(f"{name} in {label}" for label, name in first_names.items())
        return f"sources are matched by name: {listed_names} …"

    def eliminate_stars(self, excess: float = 0.0, reference: str = "") -> WhitenedDifferences:
        """The differences that are left, with an offset of `excess` between the reference and the others added.

        The same in all rows of the reference that are of one source, or of one calibrator.
        """
        pieces = [
            piece for members in self._groups_by_shape for piece in self._eliminate_groups(members, excess, reference)
        ]
        pieces = [piece for piece in pieces if piece.design.size and np.abs(piece.design).max() > 0]
        pieces.sort(key=lambda piece: piece.group)
        if not pieces:
            raise DegeneracyError(
                "no source constrains the frame: none is in two catalogues, and none is a quasar with a motion "
                f"({self.describe_matching()})"
            )
        group_rows = [self.rows[piece.group] for piece in pieces]
        return WhitenedDifferences(
            np.concatenate([piece.design for piece in pieces]),
            np.concatenate([piece.rhs for piece in pieces]),
            np.repeat(np.arange(len(pieces)), [len(piece.rhs) for piece in pieces]),
            tuple(map(self._format_source_label, group_rows)),
            np.array([self._average_magnitude(rows) for rows in group_rows]),
            np.array([len(rows) for rows in group_rows]),
            float(sum(piece.log_determinant for piece in pieces)),
        )

    @cached_property
    def _groups_by_shape(self):
        """Groups whose rows measure the same, of the same catalogues and sources: their equations have one shape."""
        is_measured = self.data.measured
        catalogue_numbers = np.unique(self.data.catalogue, return_inverse=True)[1].ravel()
        groups: dict[Any, list[int]] = {}
        for number, rows in enumerate(self.rows):
            source_numbers = np.unique(self.source[rows], return_inverse=True)[1] if len(rows) > 1 else np.zeros(1, int)
            shape_key = is_measured[rows].tobytes(), catalogue_numbers[rows].tobytes(), source_numbers.tobytes()
            groups.setdefault(shape_key, []).append(number)
        return [np.array(g[i : i + _CHUNK_SIZE]) for g in groups.values() for i in range(0, len(g), _CHUNK_SIZE)]

    def _eliminate_groups(self, members, excess, reference):
        """Eliminate the true parameters of groups of one shape."""
        data, rows = self.data, np.array([self.rows[k] for k in members])
        is_measured = data.measured[rows[0]]
        n, m = len(rows), int(is_measured.sum())
        covariance = np.zeros((n, m, m))
        cut = np.cumsum([0, *is_measured.sum(1)])
        for j, mask in enumerate(is_measured):
            covariance[:, cut[j] : cut[j + 1], cut[j] : cut[j + 1]] = data.covariance[rows[:, j]][:, mask][:, :, mask]
        if excess:
            offset = np.zeros((n, *is_measured.shape, 2))
            offset[:, data.catalogue[rows[0]] == reference, :2] = excess * np.eye(2)
            columns = offset[:, is_measured]
            covariance += columns @ columns.transpose(0, 2, 1)
        cholesky = np.linalg.cholesky(covariance)
        a, y = np.linalg.solve(cholesky, self.design[rows][:, is_measured]), self.residual[rows][:, is_measured]
        y = np.linalg.solve(cholesky, y[..., None])[..., 0]
        log_determinant = np.log(np.diagonal(cholesky, axis1=1, axis2=2)).sum(1)
        truth = self._stack_truth_derivatives(rows)[:, is_measured]
        norms = np.linalg.norm(truth, axis=1, keepdims=True)
        if truth.size:
            u, s, _ = np.linalg.svd(np.linalg.solve(cholesky, truth / np.where(norms > 0, norms, 1.0)))
            is_nonzero = (s > _RANK_LIMIT * s[:, :1]) & (s > 0)
        else:
            u, s, is_nonzero = np.tile(np.eye(m), (n, 1, 1)), np.ones((n, 0)), np.zeros((n, 0), bool)
        log_determinant += np.log(np.where(is_nonzero, s, 1.0)).sum(1)
        for i, rank in enumerate(is_nonzero.sum(1)):
            null_space = u[i, :, rank:].T
            yield _GroupDifferences(int(members[i]), null_space @ a[i], null_space @ y[i], float(log_determinant[i]))

    def _average_magnitude(self, rows):
        """Average the magnitudes of a source, or of several that stand together."""
        magnitudes = self.data.magnitude[rows][np.isfinite(self.data.magnitude[rows])]
        return magnitudes.mean() if magnitudes.size else np.nan

    def _stack_truth_derivatives(self, rows):
        """Stack the derivatives by the true parameters of all sources that stand together, (n, j, 5, 5 s)."""
        source_numbers = np.unique(self.source[rows[0]], return_inverse=True)[1].ravel()
        derivatives = np.zeros((*rows.shape, 5, source_numbers.max() + 1, 5))
        derivatives[:, np.arange(len(source_numbers)), :, source_numbers] = np.moveaxis(self.truth[rows], 1, 0)
        return derivatives.reshape(*rows.shape, 5, -1)

    def _format_source_label(self, rows):
        """The name of a source, or of the first of several and how many more there are."""
        source_numbers = np.unique(self.source[rows])
        name = str(self.data.name[rows[0]])
        return name if len(source_numbers) == 1 else f"{name} and {len(source_numbers) - 1} more"


def make_equations(
    data: AstrometryRows,
    unknowns: Unknowns,
    *,
    fixed: Mapping[str, float],
    aberration: Vector | None,
    parallax: bool = True,
    light_time: bool = True,
) -> tuple[Equations, tuple[str, ...]]:
    """Expected parameters of each row from the best-known ones of its source, and what is left; with notes."""
    source, n = data.source, len(data)
    rows_by_source = np.argsort(source, kind="stable")
    groups = tuple(np.split(rows_by_source, np.flatnonzero(np.diff(source[rows_by_source])) + 1))
    calibrator_groups = _join_by_calibrator(data, groups)
    # The magnitude of a source is that of any of its rows.
    known_columns = {role: np.full(n, np.nan) for role in ("magnitude", "radial_velocity")}
    known = np.zeros((5, n))
    epoch = np.zeros(n)
    still = np.zeros(n, bool)
    mask = data.measured
    for rows in groups:
        for role, column in known_columns.items():
            known_values = getattr(data, role)[rows]
            known_values = known_values[np.isfinite(known_values)]
            column[rows] = known_values[0] if known_values.size else np.nan
        still[rows] = data.still[rows].any()
        best_row = rows[np.argmax(mask[rows].sum(1) + 0.5 * np.isfinite(data.lon[rows]))]
        if not np.isfinite(data.lon[best_row]):
            raise FieldError(f"no row of {one_line_text(data.name[best_row])} has a position, if without an error")
        known[0, rows], known[1, rows], epoch[rows] = data.lon[best_row], data.lat[best_row], data.epoch[best_row]
        if not still[rows[0]]:
            for k in (2, 3, 4):
                known_rows = rows[np.isfinite(data.values[k, rows])]
                row = best_row if np.isfinite(data.values[k, best_row]) else known_rows[0] if known_rows.size else -1
                known[k, rows] = data.values[k, row] if row >= 0 else 0.0
    notes = _note_missing_radial_velocities(data, known_columns["radial_velocity"], still)
    moved, jacobian = propagate(
        known, np.nan_to_num(known_columns["radial_velocity"]), epoch, data.epoch, light_time=light_time
    )
    p, q, r = triad(moved[0], moved[1])
    _, _, positions = triad(np.where(mask[:, 0], data.lon, moved[0]), np.where(mask[:, 0], data.lat, moved[1]))
    if (np.sum(positions * r, 0) < np.cos(_LARGEST_OFFSET)).any():
        far = np.flatnonzero(np.sum(positions * r, 0) < np.cos(_LARGEST_OFFSET))
        raise FieldError(
            f"positions more than 1' from where the source should be: {len(far)} ({one_line_text(data.name[far[0]])} "
            f"in {data.catalogue[far[0]]}, row {far[0]}): names that are given twice, or a wrong epoch or motion"
        )
    offsets = [np.sum(axis * positions, 0) / UAS for axis in (p, q)]
    residual = np.stack([*offsets, data.parallax - moved[2], *(data.motion - moved[3:])]).T
    truth = jacobian.copy()
    truth[still, :, 2:] = 0.0
    if parallax and (data.displaced & mask[:, 0]).any():
        earth_place = earth(data.epoch)
        parallax_factors = -np.stack([np.sum(p * earth_place, 0), np.sum(q * earth_place, 0)])
        parallax_factors[:, ~data.displaced] = 0.0
        residual[:, :2] -= (parallax_factors * moved[2]).T
        truth[:, :2, 2] += parallax_factors.T * np.where(still, 0.0, 1.0)[:, None]
    functions = unknowns.functions(known_columns["magnitude"])
    design = np.zeros((n, 5, len(unknowns.names)))
    for catalogue in data.catalogues:
        mine = data.catalogue == catalogue
        design[mine] = unknowns.design(moved[0, mine], moved[1, mine], data.epoch[mine], functions[:, mine], catalogue)
    if unknowns.has_parallax_terms:
        # The weighted mean of the parallaxes of a source is independent of their differences, unlike each of them.
        weights = np.where(mask[:, 2] & ~still, 1 / data.covariance[:, 2, 2], 0.0)
        sums = np.bincount(source, weights), np.bincount(source, weights * np.where(mask[:, 2], data.parallax, 0.0))
        mean_parallax = np.divide(sums[1], sums[0], out=np.zeros(len(sums[0])), where=sums[0] > 0)[source]
        for catalogue in unknowns.turned:
            mine = (data.catalogue == catalogue) & mask[:, 2]
            zero_column, scale_column = (unknowns.names.index(name) for name in unknowns.parallax_names(catalogue))
            design[mine, 2, zero_column], design[mine, 2, scale_column] = 1.0, mean_parallax[mine]
    if np.isnan(design).any():
        unknown_sources = data.name[np.isnan(design).any((1, 2))]
        raise FieldError(
            f"{len(np.unique(unknown_sources))} sources have no magnitude, which the frame is to depend on: "
            f"{one_line_text(unknown_sources[0])} for one"
        )
    # Apparent motions follow the acceleration of the Solar System. A catalogue that is fixed to calibrators at an
    # epoch does not: there stars move against it.
    shift = np.zeros((n, 5, 3))
    axes = np.stack([p.T, q.T], 1)
    is_quasar = still & mask[:, 3]
    shift[is_quasar, 3:] += axes[is_quasar]
    shift[still, :2] += (data.epoch - epoch)[still, None, None] * axes[still]
    for catalogue, calibrator_epoch in fixed.items():
        mine = data.catalogue == catalogue
        shift[mine & ~still, :2] -= (data.epoch - calibrator_epoch)[mine & ~still, None, None] * axes[mine & ~still]
        shift[mine & ~still, 3:] -= axes[mine & ~still]
    if "acceleration" in unknowns.vectors:
        design[:, :, -3:] = shift
    elif aberration is not None:
        residual -= shift @ aberration.to_frame("icrs").value
    residual[~mask] = 0.0
    return Equations(calibrator_groups, residual, design, truth, data), notes


def _join_by_calibrator(data, groups):
    """Rows of sources that share a calibrator, joined: its error is in all of them."""
    has_calibrator = data.calibrator != ""
    if not has_calibrator.any():
        return groups
    calibrators, calibrator_numbers = np.unique(data.calibrator[has_calibrator], return_inverse=True)
    source_calibrator_graph = coo_array(
        (np.ones(int(has_calibrator.sum())), (data.source[has_calibrator], calibrator_numbers.ravel())),
        shape=(len(groups), len(calibrators)),
    ).tocsr()
    _, components = connected_components(source_calibrator_graph @ source_calibrator_graph.T, directed=False)
    return tuple(
        np.concatenate([groups[k] for k in np.flatnonzero(components == component)])
        for component in dict.fromkeys(components.tolist())
    )


def _note_missing_radial_velocities(data, radial_velocity, is_still):
    """Note fast stars near us whose radial velocity is not known."""
    with np.errstate(invalid="ignore"):
        # Perspective acceleration of 50 km/s over twenty years, 2 µ v ϖ t / A. [µas/yr]
        motion_change = np.hypot(*data.motion) * 50 * data.parallax * UAS * 2 * 20 / AU_PER_YEAR
        doubtful = np.unique(data.name[~is_still & np.isnan(radial_velocity) & (motion_change > 20)])
    if not doubtful.size:
        return ()
    return (
        f"warning: {doubtful.size} near, fast stars without a radial velocity, {one_line_text(doubtful[0])} for one: "
        "50 km/s change their motion by more than 20 µas/yr in twenty years",
    )
