"""Calibration of the basic angle from the same observations as sources and attitude.

The basic angle is Γ + Σ c_j h_j(Ω), with harmonics h_j of the spin phase Ω, counted from the Sun, and coefficients that
are constant for some days. A variation of the angle moves the preceding field of view by +1/2 of it along the scan, the
following one by −1/2; the part that both fields share is attitude.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_matrix, vstack

from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import FloatArray, IntArray

#: What is taken for Gaia: in DR2 harmonics of the spin phase were calibrated so. Offsets are free every few days, and
#: absorb nothing that changes over the sky.
GAIA_CALIBRATION = "constant to order 8"
_CALIBRATION_PATTERN = re.compile(
    r"(?:free every (?P<days>[\d.]+) days?|(?P<constant>constant))(?: to order (?P<order>\d+))?"
    r"(?:,? known to (?P<known>[\d.]+(?:e[+-]?\d+)?) ?[µμu]as)?"
)
#: Knots of the attitude that an interval of a calibration has at least: the response of the attitude to one
#: interval has then died out before the next but one.
_MIN_KNOTS = 10


@dataclass(frozen=True)
class Calibration(Frozen):
    """Model of the variations of the basic angle that are solved for together with sources and attitude.

    Parameters
    ----------
    order : int
        The highest harmonic of the spin phase from the Sun; 0 is an offset alone.
    days : float
        For how long each coefficient is constant, to within a whole number of intervals in the mission; infinite for
        the whole of it. [day]
    known : float
        Prior standard deviation of each coefficient; infinite where nothing is known of it. [µas]

    Raises
    ------
    ParameterError
        If `order` is negative, or `days` or `known` is not above zero.

    Notes
    -----
    In EDR3 the offset of each field of view was solved for in 310 intervals of 34 months, which is every 3.3 days
    (Lindegren et al. 2021, A&A 649, A2, table 2); in DR2 the harmonics of the spin phase were constants, or linear
    functions of time (Lindegren et al. 2018, A&A 616, A2, section 3.4). The along-scan scale of a field of view is no
    part of it: it moves the CCDs of a transit symmetrically about their mean, which is what a transit is here.

    Examples
    --------
    >>> Calibration.parse("free every 5 days to order 1, known to 0.1 µas")
    Calibration(order=1, days=5.0, known=0.1)
    >>> print(Calibration(order=8, days=np.inf))
    constant to order 8
    """

    order: int = 0
    days: float = 5.0
    known: float = np.inf

    def __post_init__(self) -> None:
        arguments.whole("order", self.order, 0)
        if not (self.days > 0 and self.known > 0):
            raise ParameterError(f"days and known of a calibration must be positive, not {self.days} and {self.known}")

    def __str__(self) -> str:
        interval = "constant" if np.isinf(self.days) else f"free every {self.days:g} days"
        prior = "" if np.isinf(self.known) else f", known to {self.known:g} µas"
        return f"{interval} to order {self.order}{prior}"

    @classmethod
    def parse(cls, words: str | Calibration | None) -> Calibration | None:
        """Read a calibration from words, such as "free every 5 days to order 1, known to 0.1 µas".

        Parameters
        ----------
        words : str, Calibration or None
            "free every N days" or "constant", then, if wanted, "to order M" (default: 0), then "known to S µas"; or
            "none".

        Returns
        -------
        Calibration or None
            None for "none", where the basic angle is known.

        Raises
        ------
        ParameterError
            If the words have another form.
        """
        if words is None or isinstance(words, cls):
            return words
        if words == "none":
            return None
        match = _CALIBRATION_PATTERN.fullmatch(words.strip()) if isinstance(words, str) else None
        if match is None:
            raise ParameterError(
                f'a calibration is expected, as "free every 5 days to order 1, known to 0.1 µas", "constant to order 8"'
                f' or "none", not {words!r}'
            )
        days = np.inf if match["constant"] else float(match["days"])
        return cls(int(match["order"] or 0), days, float(match["known"] or np.inf))

    def columns(self, law: Any, since: FloatArray) -> csr_matrix:
        """Compute the basic angle at times `since` the start of `law` [yr] by each coefficient, (k, coefficients).

        Coefficients are in the order of the intervals; in each the offset, then cosine and sine of each harmonic.
        """
        z, preceding, following = law.attitude(since)
        sun = rotation_matrix("ecliptic", law.frame) @ law.sun(since)[0]
        toward_sun = sun - z * np.sum(sun * z, 0)
        mid_view = preceding + following
        phase = np.arctan2(np.sum(np.cross(toward_sun, mid_view, axis=0) * z, 0), np.sum(toward_sun * mid_view, 0))
        harmonics = [np.ones_like(phase)]
        harmonics += [function(m * phase) for m in range(1, self.order + 1) for function in (np.cos, np.sin)]
        # Intervals of one length: a short one at the end would be determined by few transits.
        n_intervals = max(1, round(law.years * 365.25 / self.days))
        interval_index = np.clip((since * n_intervals / law.years).astype(int), 0, n_intervals - 1)
        column_indices = interval_index[:, None] * len(harmonics) + np.arange(len(harmonics))
        row_starts = len(harmonics) * np.arange(len(since) + 1)
        shape = (len(since), n_intervals * len(harmonics))
        return csr_matrix((np.stack(harmonics, 1).ravel(), column_indices.ravel(), row_starts), shape)


def find_nearest_views(law: Any, r: FloatArray, since: FloatArray) -> IntArray:
    """+1 where directions (3, k) are nearer to the preceding field of view, −1 where to the following one."""
    _, preceding, following = law.attitude(since)
    return np.where(np.sum(r * preceding, 0) > np.sum(r * following, 0), 1, -1)


class AngleBlock:
    """The basic angle among the unknowns of a joint solution, eliminated after the attitude.

    With H half the angle's columns, signed by the field of view, W the weights along the scan, A the attitude's
    matrix and B that of attitude and angle, the coefficients are T⁻¹ Hᵀ W r for observations r that are free of
    attitude, T = Hᵀ W H + 1/known² − Bᵀ A⁻¹ B. The response of the attitude to an interval dies out within it: T
    connects neighbours only, and every third interval is solved for together.
    """

    def __init__(self, equations: Any, calibration: Calibration) -> None:
        scans = equations.scans
        if scans.law is None:
            raise ParameterError("a calibration of the basic angle needs the scanning law: make the scans anew")
        if calibration.days * 86400 < _MIN_KNOTS * scans.spacing * 365.25 * 86400:
            raise ParameterError(
                f"a basic angle that is free every {calibration.days:g} days needs knots of the attitude at most "
                f"{calibration.days * 86400 / _MIN_KNOTS:.0f} s apart, not {scans.spacing * 365.25 * 86400:.0f} s"
            )
        self.equations, self.calibration = equations, calibration
        self._weights = scans.weights[0, scans.source] * equations.solved[scans.source]
        directions = triad(scans.lon, scans.lat)[2]
        column_blocks = []
        for block in scans.blocks():
            since = scans.time(block)
            half_sign = find_nearest_views(scans.law, directions[:, scans.source[block]], since) / 2
            column_blocks.append(calibration.columns(scans.law, since).multiply(half_sign[:, None]).tocsr())
        self._columns = vstack(column_blocks, format="csr")
        self._factor = cho_factor(self._compute_schur_complement(), check_finite=False)

    def fit_coefficients(self, along: FloatArray) -> FloatArray:
        """Fit the coefficients to observations `along` the scan that are free of attitude."""
        return cho_solve(self._factor, self._project_on_columns(along), check_finite=False)

    def compute_along_shifts(self, coefficients: FloatArray) -> FloatArray:
        """Compute the displacements along the scan by `coefficients`, (k,)."""
        return np.asarray(self._columns @ coefficients)

    def compute_effects(self, coefficients: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute what `coefficients` change: along the scan (k,), at the sources (n, 5), in the attitude."""
        along = self.compute_along_shifts(coefficients)
        source_rhs, attitude_rhs = self.equations.passes.adjoint(along, np.zeros_like(along))
        attitude = self.equations.attitude_of(attitude_rhs)
        return along, source_rhs - self.equations.passes.to_sources(attitude[..., None])[..., 0], attitude

    def compute_absorbed_part(self, x: FloatArray, attitude: FloatArray) -> FloatArray:
        """Compute the part that the angle absorbs of parameters `x` (n, 5, K) less their `attitude`."""
        absorbed = np.empty_like(x)
        for k in range(x.shape[-1]):
            parameters, attitude_column = np.ascontiguousarray(x[..., k]), np.ascontiguousarray(attitude[..., k])
            along, _ = self.equations.passes.predict(parameters, -attitude_column)
            absorbed[..., k] = self.compute_effects(self.fit_coefficients(along))[1]
        return absorbed

    def _project_on_columns(self, along):
        return self._columns.T @ (self._weights * along)

    def _compute_schur_complement(self):
        """T, (coefficients, coefficients)."""
        n_harmonics, size = 2 * self.calibration.order + 1, self._columns.shape[1]
        matrix = (self._columns.T @ self._columns.multiply(self._weights[:, None])).toarray()
        zero_parameters = np.zeros((self.equations.scans.n_sources, 5))
        interval = np.arange(size) // n_harmonics
        for colour in range(3):
            for harmonic in range(n_harmonics):
                chosen_columns = np.flatnonzero((interval % 3 == colour) & (np.arange(size) % n_harmonics == harmonic))
                coefficients = np.zeros(size)
                coefficients[chosen_columns] = 1
                attitude = self.compute_effects(coefficients)[2]
                response = self._project_on_columns(self.equations.passes.predict(zero_parameters, attitude)[0])
                for column in chosen_columns:
                    is_neighbour = np.abs(interval - interval[column]) <= 1
                    matrix[is_neighbour, column] -= response[is_neighbour]
        matrix = (matrix + matrix.T) / 2
        matrix[np.diag_indices(size)] += np.where(np.diag(matrix) > 0, 0.0, 1.0) + 1 / self.calibration.known**2
        try:
            np.linalg.cholesky(matrix)
        except LinAlgError:
            raise DegeneracyError(
                f"a basic angle that is {self.calibration} is not determined: lower its order, or take longer intervals"
            ) from None
        return matrix
