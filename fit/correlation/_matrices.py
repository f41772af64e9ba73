"""Correlation matrices of parameters, and the influence of each pixel of the sky on a result."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from fit.direct import solve_frame
from fit.normal import normal_equations, solve
from fit.results.solution import predict_motions
from fit.results.storage import Result, check_strings, from_hex, to_hex
from vsh import Coefficients
from vsh.coefficients import FIRST_DEGREE
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, as_parts
from vsh.io.sections import Section
from vsh.modes import KINDS, Modes, as_modes
from vsh.sky.frames import check_frame
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import covariance, float_array, positive
from vsh.tools.errors import FrameError, ModesError, ParameterError, TableError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, Axes, FloatArray, Table
from vsh.vector import correlation_of

#: Name that stands for the six components of spin and acceleration.
FRAME: Literal["spin+acceleration"] = "spin+acceleration"
FRAME_NAMES = tuple(f"{vector}_{axis}" for vector in ("omega", "a") for axis in "xyz")


def find_largest_correlation(matrix: FloatArray, names: Sequence[str]) -> tuple[float, tuple[str, str]]:
    """Find the largest off-diagonal correlation of a matrix, and the names of its two parameters."""
    rows, columns = np.triu_indices(len(names), 1)
    k = int(np.argmax(np.abs(matrix[rows, columns])))
    return float(matrix[rows[k], columns[k]]), (names[rows[k]], names[columns[k]])


@dataclass(frozen=True, eq=False)
class Parameters(Frozen):
    """Named parameters that are linear functions of the coefficients."""

    names: tuple[str, ...]
    modes: Modes
    rows: FloatArray

    def __len__(self) -> int:
        return len(self.names)

    def covariance(self, covariance: FloatArray) -> FloatArray:
        """Compute the covariance (k, k) of these parameters from the `covariance` of the coefficients."""
        return self.rows @ covariance @ self.rows.T


def parameters_of(parameters: Modes | int | str) -> Parameters:
    """Return the parameters that modes, a degree or "spin+acceleration" stand for."""
    if isinstance(parameters, str):
        return select_parameters(FRAME_NAMES, parameters)
    modes = as_modes(parameters)
    return Parameters(tuple(map(str, modes)), modes, np.eye(len(modes)))


def select_parameters(names: Sequence[str], parameters: Modes | int | str) -> Parameters:
    """Select parameters of a fit by name: coefficients such as "t(1,0)", or omega_x … a_z."""
    if isinstance(parameters, str):
        if parameters != FRAME:
            raise ParameterError(f"parameters must be {FRAME!r}, a degree or Modes, not {parameters!r}")
        parameters = 1
    modes = as_modes(parameters)
    rows = {str(mode): row for mode, row in zip(modes, np.eye(len(modes)), strict=True)}
    inverse = np.linalg.inv(FIRST_DEGREE)
    for kind, vector in zip(KINDS, ("omega", "a"), strict=True):
        for axis, row in zip("xyz", inverse, strict=True):
            coefficient_row = np.zeros(len(modes))
            coefficient_row[modes.slice_of(kind, 1)] = row
            rows[f"{vector}_{axis}"] = coefficient_row
    unknown_names = [name for name in names if name not in rows]
    if unknown_names:
        raise ParameterError(
            f"no parameter is called {', '.join(unknown_names)}; there are {', '.join(FRAME_NAMES)}, "
            f"{', '.join(map(str, modes))}"
        )
    return Parameters(tuple(names), modes, np.stack([rows[name] for name in names]))


def check_unmodelled_higher(fitted: Modes, unmodelled: Modes) -> None:
    """Raise ModesError unless `unmodelled` has a higher degree than `fitted`."""
    if not unmodelled.lmax > fitted.lmax:
        raise ModesError(f"unmodelled degrees must be above the fitted degree {fitted.lmax}, not {unmodelled.lmax}")


def field_from_positions(sources: Any, sigma: ArrayLike | None = None) -> Field | Parts:
    """Convert sources that have positions and errors to a Field or to Parts; motions are not needed.

    Parameters
    ----------
    sources : Field, Parts, Population, or anything with lon and lat [rad], and perhaps sigma, rho, frame
        The sources.
    sigma : float or (2, n) array, optional
        Errors that replace the sources' own; a single number for Parts. [µas/yr]

    Raises
    ------
    FieldError
        If the sources have no positions, or no errors and none are given.
    """
    if not isinstance(sources, Parts):
        return Field.from_positions(sources, sigma)
    return sources if sigma is None else sources.map(partial(Field.from_positions, sigma=positive("sigma", sigma)))


#: Largest number of parameters for which the matrix is printed; larger matrices are only written to files.
_MAX_PRINTED_PARAMETERS = 16


@dataclass(frozen=True, eq=False, repr=False)
class CorrelationMatrices(Result):
    """Correlations of the same parameters on one or several skies.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    matrices : list of (k, k) arrays
    labels : tuple of str
        Names of the catalogues.
    dipoles : list of (3,) arrays
        r̄, the weighted mean unit vector of the sources of each catalogue. To first order, and if all
        errors are equal, it determines the correlations of spin and acceleration: −(3/2) [r̄]ₓ, with [r̄]ₓ v = r̄ × v.
    frame : str
    """

    names: tuple[str, ...]
    matrices: list
    labels: tuple[str, ...]
    dipoles: list
    frame: str

    def __repr__(self) -> str:
        return f"<CorrelationMatrices: {', '.join(self.labels)}; {len(self.names)} parameters, {self.frame}>"

    def matrix(self, i: int = 0) -> FloatArray:
        """Return the correlation matrix of catalogue `i`, (k, k)."""
        return self.matrices[i]

    def combined(self, upper: int = 0, lower: int = 1) -> FloatArray:
        """Combine two catalogues in one matrix: `upper` above the diagonal, `lower` below."""
        if len(self.matrices) == 1:
            return self.matrices[0]
        k = len(self.names)
        return np.triu(self.matrices[upper], 1) + np.tril(self.matrices[lower], -1) + np.eye(k)

    def dipole_prediction(self, i: int = 0) -> FloatArray:
        """Compute −(3/2) [r̄]ₓ, the block ω–ã that the dipole of catalogue `i` alone would give, (3, 3)."""
        x, y, z = self.dipoles[i]
        return -1.5 * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])

    def largest(self, i: int = 0) -> tuple[float, tuple[str, str]]:
        """Find the largest correlation of catalogue `i`, and the names of its two parameters."""
        return find_largest_correlation(self.matrices[i], self.names)

    def to_table(self) -> Table:
        """Return the matrix as an astropy Table; two catalogues are in its upper and lower triangles."""

        meta = {"frame": self.frame, "upper": self.labels[0], "lower": self.labels[min(1, len(self.labels) - 1)]}
        columns = {"parameter": list(self.names)} | dict(zip(self.names, self.combined().T, strict=True))
        return tables.table_of(columns, meta)

    def _sections(self, long):
        upper, lower = self.labels[0], self.labels[min(1, len(self.labels) - 1)]
        facts = [("axes", self.frame)]
        facts += [("above diagonal", upper), ("below diagonal", lower)] if upper != lower else []
        for i, label in enumerate(self.labels):
            value, pair = self.largest(i)
            facts.append((label, f"largest correlation {value:+.3f}, of {pair[0]} and {pair[1]}"))
        remarks = []
        if long and {"omega_x", "a_x"} <= set(self.names):
            remarks = [line for i in range(len(self.labels)) for line in self._explain_by_dipole(i)]
        is_small = len(self.names) <= _MAX_PRINTED_PARAMETERS
        table, forms = self.to_table() if is_small else None, dict.fromkeys(self.names, ".3f")
        return (Section("Correlations", facts, table, forms=forms, remarks=remarks),)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Plot the matrix of one catalogue, or of two in its upper and lower triangles."""
        from fit.correlation._plot import plot_matrix

        return plot_matrix(self, ax=ax)

    def _pack(self):
        columns = {"parameter": list(self.names)} | {f"matrix_{i}": matrix for i, matrix in enumerate(self.matrices)}
        dipoles = [[to_hex(x) for x in dipole] for dipole in self.dipoles]
        return columns, {"labels": list(self.labels), "frame": self.frame, "dipoles": dipoles}, {}

    @classmethod
    def _unpack(cls, columns, metadata):
        labels, names = check_strings(metadata["labels"]), tuple(columns["parameter"].tolist())
        dipoles = [float_array("dipole", [from_hex(x) for x in dipole], (3,)) for dipole in metadata["dipoles"]]
        matrices = [covariance(f"matrix_{i}", columns[f"matrix_{i}"], len(names)) for i in range(len(labels))]
        has_large = any((np.abs(matrix) > 1 + 1e-9).any() for matrix in matrices)
        if len(dipoles) != len(labels) or has_large or len(set(names)) < len(names):
            raise TableError("labels, names or correlations")
        return cls(names, matrices, labels, dipoles, check_frame(metadata["frame"]))

    def _explain_by_dipole(self, i):
        x, y, z = self.dipoles[i]
        spin_start, glide_start = self.names.index("omega_x"), self.names.index("a_x")
        spin_glide_block = self.matrices[i][spin_start : spin_start + 3, glide_start : glide_start + 3]
        mean_text = f"  weighted mean unit vector of the sources: ({x:+.3f}, {y:+.3f}, {z:+.3f})"
        lines = [f"{mean_text}; largest correlations, and how much of them this dipole explains:"]
        prediction = self.dipole_prediction(i)
        largest_cells = np.argsort(-np.abs(spin_glide_block), axis=None)[:3]
        for row, column in zip(*np.unravel_index(largest_cells, (3, 3)), strict=True):
            axis_name = "xyz"[3 - row - column] if row != column else "none"
            lines.append(
                f"  omega_{'xyz'[row]} and a_{'xyz'[column]}: {spin_glide_block[row, column]:+.3f}, of which "
                f"{prediction[row, column]:+.3f} is explained by the dipole along {axis_name}"
            )
        return lines


def correlation_matrices(
    fields: Any,
    parameters: Modes | int | Literal["spin+acceleration"] = FRAME,
    *,
    labels: Sequence[str] | None = None,
    offsets: Field | Sequence[Field] | None = None,
    solver: Literal["harmonics", "frame"] = "harmonics",
    sigma: ArrayLike | None = None,
) -> CorrelationMatrices:
    """Compute the correlation matrices of one or several catalogues from positions and errors alone.

    Parameters
    ----------
    fields : Field, Parts, positions with errors, or a list or dict of them
        The catalogues.
    parameters : "spin+acceleration", Modes, or a degree
        The components of spin and acceleration, or all coefficients.
    labels : list of str, optional
        Names of the catalogues.
    offsets : Field or list of Fields, optional
        Offsets of VLBI sources. If given, the orientation ε comes first, as in Bachchan et al. (2016).
    solver : {"harmonics", "frame"}
        "frame" uses the direct frame solver, which is for spin and acceleration only.
    sigma : float, optional
        Errors in place of the sources' own; required if they have none. [µas/yr]

    Raises
    ------
    FrameError
        If the catalogues are in different frames.
    DegeneracyError
        If a catalogue cannot separate the parameters.
    """
    if isinstance(fields, dict):
        labels, fields = list(fields), list(fields.values())
    catalogues = fields if isinstance(fields, (list, tuple)) else [fields]
    fields = [field_from_positions(catalogue, sigma) for catalogue in catalogues]
    if not fields:
        raise ParameterError("at least one catalogue is required")
    labels = tuple(labels or (f"catalogue {i + 1}" for i in range(len(fields))))
    if len(labels) != len(fields):
        raise ParameterError(f"{len(labels)} labels for {len(fields)} catalogues")
    if solver not in ("harmonics", "frame"):
        raise ParameterError(f'solver is "harmonics" or "frame", not {solver!r}')
    parameter_set = parameters_of(parameters)
    if (solver == "frame" or offsets is not None) and parameters != FRAME:
        raise ParameterError("solver='frame' and offsets= can only be used with parameters='spin+acceleration'")
    if offsets is not None:
        offset_fields: list[Any] = list(offsets) if isinstance(offsets, (list, tuple)) else [offsets] * len(fields)
        if len(offset_fields) != len(fields):
            raise ParameterError(f"{len(offset_fields)} fields of offsets for {len(fields)} catalogues")
    matrices, names, dipoles, frames = [], parameter_set.names, [], []
    for i, field in enumerate(fields):
        if solver == "frame" or offsets is not None:
            frame_solution = solve_frame(field, None if offsets is None else offset_fields[i])
            matrices.append(frame_solution.correlation)
            names = frame_solution.names
            frames.append(frame_solution.frame)
        else:
            solution = solve(normal_equations(field, parameter_set.modes))
            matrices.append(correlation_of(parameter_set.covariance(solution.covariance)))
            frames.append(solution.frame)
        dipoles.append(compute_mean_unit_vector(field))
        if frames[i] != frames[0]:
            raise FrameError(f"the catalogues are in {frames[0]} and {frames[i]}: convert them to one frame")
    return CorrelationMatrices(names, matrices, labels, dipoles, frames[0])


def compute_mean_unit_vector(field: Field | Parts) -> FloatArray:
    """Compute the weighted mean unit vector of the sources, (3,); it is zero on a uniform sky."""
    vector, weight = as_parts(field).sum(_sum_weighted_directions, roles=(), words="dipole")
    return vector / weight


def _sum_weighted_directions(field):
    weight = field.information
    return triad(field.lon, field.lat)[2] @ weight, weight.sum()


@arguments.accepts(nside=arguments.whole)
def influence_map(
    sources: Any,
    modes: Modes | int | Literal["spin+acceleration"],
    parameters: str | Sequence[str],
    nside: int = 16,
    *,
    quantity: Literal["value"] | None = None,
    sigma: ArrayLike | None = None,
) -> FloatArray:
    """Compute the exact derivative of a result with respect to the weight of each HEALPix pixel.

    Parameters
    ----------
    sources : Field, or positions with errors as for `fit.correlation.predict_covariance`
        The sources.
    modes : Modes, or the degree lmax, or "spin+acceleration" (degree 1)
        Modes that are fitted.
    parameters : (str, str) or str
        Names of two parameters ("omega_y", "a_x", "t(2,0)"), for their correlation, or of one, for its variance.
    nside : int
        Resolution of the HEALPix pixels.
    quantity : "value", optional
        "value" maps the value of one parameter in place of its variance; this requires motions.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    (12 nside²,) array, ring order, axes of the sources
        dρ/d ln w, d ln σ²/d ln w or dθ/d ln w [µas/yr], with w the weight of all sources in a pixel.
        To first order, this is the change of the result if w were doubled.

    Notes
    -----
    With C = N⁻¹ and N = Σ wₖ Nₖ, ∂C/∂wₖ = −C Nₖ C. The derivative of Cᵢⱼ by ln wₖ is −Σ gᵢᵀ W gⱼ over the
    sources of pixel k, where gᵢ is the field whose coefficients are column i of C, and W a source's inverse covariance.
    """
    from vsh.sky.pixels import pixels_of

    field = Field.from_positions(sources, sigma)
    pixels = pixels_of(field.lon, field.lat, nside)
    return np.bincount(pixels, _compute_influences(field, modes, parameters, quantity), 12 * nside**2).astype(float)


def _compute_influences(field, modes, parameters, quantity):
    """Compute the derivative with respect to ln of the weight of each source, (n,)."""
    covariance, row_i, row_j, parameter_set = _solve_and_select_rows(field, modes, parameters)
    g = predict_motions(Coefficients(parameter_set.modes, covariance @ row_i), field)
    if quantity == "value":
        if len(parameter_set) != 1:
            raise ParameterError('quantity="value" maps the value of one parameter: give one name')
        residual = solve(normal_equations(field, parameter_set.modes)).residuals(field).motion
        return field.inner(g, residual)
    if quantity is not None:
        raise ParameterError(f'quantity is None or "value", not {quantity!r}')
    h = None if row_j is None else predict_motions(Coefficients(parameter_set.modes, covariance @ row_j), field)
    return _differentiate_by_weight(covariance, row_i, row_j, g, h, field)


def _differentiate_by_weight(covariance, row_i, row_j, g, h, field):
    """Compute dρ for two parameters, or d ln σ² for one."""
    c_ii = row_i @ covariance @ row_i
    if row_j is None:
        return -field.inner(g, g) / c_ii
    c_jj, c_ij = row_j @ covariance @ row_j, row_i @ covariance @ row_j
    rho = c_ij / np.sqrt(c_ii * c_jj)
    variance_change = field.inner(g, g) / c_ii + field.inner(h, h) / c_jj
    return -field.inner(g, h) / np.sqrt(c_ii * c_jj) + rho / 2 * variance_change


def _solve_and_select_rows(field, modes, parameters):
    if not isinstance(parameters, (str, tuple, list)) or not all(isinstance(name, str) for name in parameters):
        raise ParameterError(f"parameters must be one or two names, not {parameters!r}")
    names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
    if len(names) not in (1, 2) or len(set(names)) != len(names):
        raise ParameterError(f"parameters must be one name or two different names, not {parameters!r}")
    modes = as_modes(1 if isinstance(modes, str) and modes == FRAME else modes)
    parameter_set = select_parameters(names, modes)
    covariance = solve(normal_equations(field, modes)).covariance
    return covariance, parameter_set.rows[0], parameter_set.rows[1] if len(names) == 2 else None, parameter_set
