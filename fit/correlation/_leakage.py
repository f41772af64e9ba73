"""Leakage: harmonics are not orthogonal on a non-uniform sky, and degrees that are not fitted bias those that are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.correlation._matrices import FRAME_NAMES, check_unmodelled_higher, field_from_positions, select_parameters
from fit.normal import normal_equations, solve
from fit.results.storage import Result, check_strings
from vsh import Coefficients, Modes
from vsh.io import tables
from vsh.io.sections import Section
from vsh.modes import as_modes
from vsh.sky.frames import check_frame
from vsh.tools import arguments
from vsh.tools.arguments import float_array
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.types import ArrayLike, AxesArray, FloatArray, OnAxes, Table
from vsh.vector import correlation_of


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Leakage(Result):
    """Leakage of unmodelled coefficients c_u into the fitted ones: bias = matrix · c_u.

    Attributes
    ----------
    matrix : (p, p') array
        N_ff⁻¹ N_fu.
    fitted, unmodelled : Modes
        The second to the highest unmodelled degree; its columns begin above `fitted`.
    names, unmodelled_names : tuples of str
        Names of rows and columns.
    frame : str
    """

    matrix: FloatArray
    fitted: Modes
    unmodelled: Modes
    names: tuple[str, ...]
    unmodelled_names: tuple[str, ...]
    frame: str

    def __repr__(self) -> str:
        return f"<Leakage of degrees {self.fitted.lmax + 1} to {self.unmodelled.lmax} into 1 to {self.fitted.lmax}>"

    def of(self, coefficients: Coefficients) -> Coefficients:
        """The bias by a given field, `coefficients` [µas/yr], as Coefficients; its fitted degrees do not count."""
        unmodelled_values = self._select_unmodelled(coefficients.to_degree(self.unmodelled.lmax).values)
        return Coefficients(self.fitted, self.matrix @ unmodelled_values)

    def covariance(self, power: float | Mapping[int, float] | ArrayLike) -> FloatArray:
        """Covariance of the biases, (p, p), for a Gaussian random field. [(µas/yr)²]

        Parameters
        ----------
        power : float, dict or array
            ∫ |V_l|² dΩ of one kind and degree on average: the same for all, by degree {l: power}, an array
            from the first unmodelled degree on, or two rows of it, T and S. [(µas/yr)²]
        """
        variance = self._select_unmodelled(self._compute_variances(power))
        return (self.matrix * variance) @ self.matrix.T

    def bias(self, power: float | Mapping[int, float] | ArrayLike) -> FloatArray:
        """Rms bias of each fitted coefficient, (p,), for a Gaussian random field of `power` ∫ |V_l|² dΩ. [µas/yr]

        `power` as for `covariance`.
        """
        return np.sqrt(np.diag(self.covariance(power)))

    def bias_of(self, names: Sequence[str], power: float | Mapping[int, float] | ArrayLike) -> dict[str, float]:
        """Rms bias by `names`, omega_x … a_z or coefficients, for a `power` as in `bias`: a dict. [µas/yr]"""
        parameters = select_parameters(names, self.fitted)
        return dict(zip(names, np.sqrt(np.diag(parameters.covariance(self.covariance(power)))).tolist(), strict=True))

    def to_table(self) -> Table:
        """The matrix as an astropy Table: a row a fitted coefficient."""
        columns = {"coefficient": list(self.names)} | dict(zip(self.unmodelled_names, self.matrix.T, strict=True))
        return tables.table_of(columns, {"frame": self.frame})

    def _sections(self, long):
        biases = self.bias_of(FRAME_NAMES, 1.0)
        table = tables.table_of({"parameter": list(biases), "bias": list(biases.values())}, {}, {"bias": "uas / yr"})
        return (Section(f"{self!r}: rms bias by a power of 1 (µas/yr)² in each", (), table),)

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """The matrix as a picture."""
        from fit.correlation._plot import plot_leakage

        return plot_leakage(self, ax=ax)

    def _pack(self):
        columns = {"coefficient": list(self.names), "matrix": self.matrix}
        metadata = {"fitted": self.fitted.lmax, "unmodelled": self.unmodelled.lmax, "frame": self.frame}
        return columns, metadata | {"names": list(self.unmodelled_names)}, {}

    @classmethod
    def _unpack(cls, columns, metadata):
        fitted, unmodelled = Modes(metadata["fitted"]), Modes(metadata["unmodelled"])
        check_unmodelled_higher(fitted, unmodelled)
        unmodelled_names = tuple(str(mode) for mode in unmodelled if mode.l > fitted.lmax)
        names = tuple(columns["coefficient"].tolist())
        if names != tuple(map(str, fitted)) or check_strings(metadata["names"]) != unmodelled_names:
            raise TableError("names of coefficients")
        matrix = float_array("matrix", columns["matrix"], (len(names), len(unmodelled_names)))
        return cls(
            matrix=matrix,
            fitted=fitted,
            unmodelled=unmodelled,
            names=names,
            unmodelled_names=unmodelled_names,
            frame=check_frame(metadata["frame"]),
        )

    def _select_unmodelled(self, values):
        return values[[i for i, mode in enumerate(self.unmodelled) if mode.l > self.fitted.lmax]]

    def _compute_variances(self, power):
        modes = self.unmodelled
        lmin = self.fitted.lmax + 1
        spectrum = np.zeros((2, modes.lmax + 1))
        if isinstance(power, Mapping):
            for l, value in power.items():
                if not lmin <= l <= modes.lmax:
                    raise ParameterError(f"degree {l} is none of the unmodelled degrees {lmin} to {modes.lmax}")
                spectrum[:, l] = value
        else:
            power = np.asarray(power, float)
            if power.ndim and power.shape[-1] != modes.lmax + 1 - lmin:
                raise ParameterError(f"a power for each degree {lmin} to {modes.lmax} is expected, not {power.shape}")
            spectrum[:, lmin:] = power
        if not (spectrum >= 0).all():
            raise ParameterError("a power cannot be negative")
        kind_rows = np.array([mode.kind == "S" for mode in modes], int)
        degrees = np.array([mode.l for mode in modes])
        return spectrum[kind_rows, degrees] / (2 * degrees + 1) / modes.norm2


def leakage(sources: Any, fitted: Modes | int, unmodelled: Modes | int, *, sigma: ArrayLike | None = None) -> Leakage:
    """The matrix that carries unmodelled degrees into the fitted ones.

    Parameters
    ----------
    sources : Field, Parts, or positions with errors as for `fit.correlation.predict_covariance`
        As for `fit.correlation.predict_covariance`.
    fitted, unmodelled : Modes, or degrees
        Fitted to the first, with a true field up to the second.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]
    """
    fitted, unmodelled = as_modes(fitted), as_modes(unmodelled)
    check_unmodelled_higher(fitted, unmodelled)
    normal = normal_equations(field_from_positions(sources, sigma), unmodelled)
    is_fitted = np.array([mode.l <= fitted.lmax for mode in unmodelled])
    fitted_matrix = normal.matrix[np.ix_(is_fitted, is_fitted)]
    fitted_equations = replace(normal, modes=fitted, matrix=fitted_matrix, rhs=normal.rhs[is_fitted])
    solve(fitted_equations)  # tells what such a fit cannot separate
    matrix = np.linalg.solve(fitted_matrix, normal.matrix[np.ix_(is_fitted, ~is_fitted)])
    names = np.array([str(mode) for mode in unmodelled])
    return Leakage(
        matrix=matrix,
        fitted=fitted,
        unmodelled=unmodelled,
        names=tuple(names[is_fitted]),
        unmodelled_names=tuple(names[~is_fitted]),
        frame=normal.frame or "icrs",
    )


@arguments.accepts(max_lmax=arguments.whole)
def lmax_table(sources: Any, max_lmax: int = 10, *, sigma: ArrayLike | None = None) -> list[tuple[int, float, float]]:
    """Condition and largest correlation of the fit to each highest degree.

    Parameters
    ----------
    sources : Field, Parts, or positions with errors as for `fit.correlation.predict_covariance`
        The sources; no motions are needed.
    max_lmax : int
        The highest degree that is tried.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    list of (lmax, condition, correlation)
        The condition number of the normal matrix with a diagonal of ones, and the largest correlation of two
        coefficients; inf and 1 where the sources do not determine the fit.
    """
    modes = Modes(max_lmax)
    normal = normal_equations(field_from_positions(sources, sigma), modes)
    rows = []
    for lmax in range(1, max_lmax + 1):
        is_fitted = np.array([mode.l <= lmax for mode in modes])
        block = normal.matrix[np.ix_(is_fitted, is_fitted)]
        diagonal = np.sqrt(np.diag(block))
        values = np.linalg.eigvalsh(block / np.outer(diagonal, diagonal)) if (diagonal > 0).all() else np.zeros(2)
        if values[0] <= 1e-12 * values[-1] or normal.n_data < is_fitted.sum():
            rows.append((lmax, float("inf"), 1.0))
            continue
        correlation = correlation_of(np.linalg.inv(block))
        rows.append((lmax, float(values[-1] / values[0]), float(np.abs(correlation - np.eye(len(block))).max())))
    return rows
