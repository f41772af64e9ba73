"""Two catalogues of one sky: how one frame is turned, drifts and is deformed against the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fit.correlation import CorrelationMatrices, correlation_matrices
from fit.output import report
from fit.quality import f_p_value, printed_p_value
from fit.robust import clip, student_t
from fit.solution import AboutSolution, Solution
from vsh.conventions import ICRF3, to_icrf3
from vsh.field import Field
from vsh.io import tables
from vsh.io.catalogue import counterparts, match
from vsh.modes import Modes, as_modes
from vsh.sky.positions import Positions
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.modules import old_names
from vsh.tools.types import FloatArray, Table

__all__ = ["FrameComparison", "compare_catalogues"]
#: Outliers that the report lists.
_LISTED = 10
#: What is so many times farther than the limit from a robust fit is left out before the first plain one.
_FAR = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class FrameComparison(AboutSolution):
    """One catalogue less another.

    Attributes
    ----------
    labels : tuple of str
        Names of the two.
    solution : Solution
        Fitted to the differences that agree with it: `spin` is the rotation, `acceleration` the glide, and beyond
        degree 1 is the deformation. [µas of positions, µas/yr of motions]
    names : tuple of str
        Names of the sources that were left out, the farthest first.
    offsets : (k, 2) array
        Their differences, east and north. [the unit of the solution]
    distances : (k,) array
        How far each is from the fit, √(ΔᵀC⁻¹Δ) of both components.
    factor : float
        By which errors would have to be multiplied for χ² to be as expected.
    correlations : CorrelationMatrices
        Correlations of the coefficients, by the errors of either catalogue alone at the sources they have in common.
    """

    labels: tuple[str, str]
    solution: Solution
    names: tuple[str, ...]
    offsets: FloatArray
    distances: FloatArray
    factor: float
    correlations: CorrelationMatrices

    def __repr__(self) -> str:
        return (
            f"<FrameComparison: {' − '.join(self.labels)}, {self.solution.n_sources} sources, {len(self.names)} left "
            "out>"
        )

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Rotation, glide and quadrupoles with errors, by names and signs of the ICRF3 papers; to degree 2."""
        parameters = to_icrf3(self.solution.coefficients)
        sigma = self.solution.sigma
        return {
            name: (value, float(sigma[self.solution.modes.index(ICRF3[name][0])] / abs(ICRF3[name][1])))
            for name, value in parameters.items()
        }

    @property
    def deformation_p_value(self) -> float:
        """Probability of as much beyond rotation and glide from noise alone, by the errors quoted.

        Right where the errors are and the two catalogues share no noise; too large where they do (half of it shared:
        below 0.05 on no sky).
        """
        return self._deformation_p_value(1.0)

    @property
    def deformation_p_value_scaled(self) -> float:
        """The same with errors multiplied by `factor`, which residuals suggest.

        Right where noise is shared, or errors are wrong, by one factor for all sources. Where the faint share and the
        bright do not, or errors are wrong by more for some, neither is: with all noise of the fainter half shared 0.05
        came out on up to 46 % of skies.
        """
        return self._deformation_p_value(self.factor)

    def _deformation_p_value(self, factor):
        beyond = self.solution.modes.degrees > 1
        if not beyond.any():
            return float("nan")
        values, matrix = self.solution.values[beyond], self.solution.covariance[np.ix_(beyond, beyond)]
        chi2 = values @ np.linalg.solve(matrix, values) / factor**2
        dof = self.solution.dof if factor != 1 else np.inf  # the factor is an estimate
        return f_p_value(chi2, int(beyond.sum()), dof)

    def report(self) -> str:
        """The comparison as text."""
        solution, (a, b) = self.solution, self.labels
        what = "position" if solution.unit == "µas" else "motion"
        lines = [
            f"{a} − {b}: differences of {what} of {solution.n_sources} sources, {len(self.names)} left out",
            f"{'ICRF3 names':12}{'[' + solution.unit + ']':>12}{'±':>10}{'in errors':>12}",
        ]
        for name, (value, error) in self.parameters.items():
            lines.append(f"{name:12}{value:+12.2f}{error:10.2f}{value / error:+12.1f}")
        if solution.modes.lmax > 1:
            lines.append(
                f"deformation (degrees 2 to {solution.modes.lmax}): p = {printed_p_value(self.deformation_p_value)} of "
                "as much from noise alone, by the errors quoted"
                + (f"; {printed_p_value(self.deformation_p_value_scaled)} by scaled ones" if self.factor != 1 else "")
            )
        if self.factor > 1:
            lines.append(f"residuals suggest errors {self.factor:.3g} times as large: multiply those above by it")
        if self.factor < 1:
            lines.append(
                f"residuals are {self.factor:.3g} of their errors: the catalogues share observations, or errors are too"
                " large. The scaled p-value holds where all share alike; errors above stay as they are, since what is "
                "shared may still be wrong in both"
            )
        for label, index in ((a, 0), (b, 1)):
            value, pair = self.correlations.largest(index)
            lines.append(f"largest correlation by the errors of {label} alone: {value:+.3f} of {pair[0]} and {pair[1]}")
        if self.names:
            lines.append(f"farthest off, of {len(self.names)} left out:")
            rows = zip(self.names, self.offsets, self.distances, strict=True)
            lines += [
                f"  {n:24}{east:+12.1f}, {north:+.1f} {solution.unit}, {x:.1f} times its error"
                for n, (east, north), x in list(rows)[:_LISTED]
            ]
        return "\n".join(lines) + "\n\n" + report(solution)

    def parameters_table(self) -> Table:
        """`parameters`, a row each, as an astropy Table."""
        unit, (values, errors) = (
            "uas" if self.solution.unit == "µas" else "uas / yr",
            np.transpose(list(self.parameters.values())),
        )
        columns = {"ICRF3": list(self.parameters), "value": values, "sigma": errors, "in_errors": values / errors}
        return tables.table_of(columns, {"frame": self.solution.frame}, dict.fromkeys(("value", "sigma"), unit))

    def outliers_table(self) -> Table:
        """A row for each source that was left out, as an astropy Table."""
        unit = "uas" if self.solution.unit == "µas" else "uas / yr"
        columns = {
            "name": np.array(self.names, dtype=str),
            "east": self.offsets[:, 0],
            "north": self.offsets[:, 1],
            "distance": self.distances,
        }
        return tables.table_of(columns, {"frame": self.solution.frame}, dict.fromkeys(("east", "north"), unit))


@arguments.accepts(threshold=arguments.positive)
def compare_catalogues(
    a: Positions | Field,
    b: Positions | Field,
    modes: Modes | int = 2,
    *,
    by: Literal["name", "position"] = "name",
    radius: Any = None,
    threshold: float = 5.0,
    labels: Sequence[str] = ("A", "B"),
) -> tuple[FrameComparison, Field]:
    """Match two catalogues and fit a − b, with the sum of their covariances.

    Parameters
    ----------
    a, b : Positions, or Fields
        From positions: orientation, glide and deformation [µas]; from motions the same a year [µas/yr].
    modes : Modes, or the degree lmax
        What to fit.
    by, radius
        As for `vsh.io.catalogue.match`.
    threshold : float
        Differences farther than so many errors from the fit are outliers: left out and listed.
    labels : two str
        What the catalogues are called.

    Returns
    -------
    comparison : FrameComparison
    differences : Field
        Differences of the sources that were fitted.

    Raises
    ------
    TableError, FrameError, FieldError
        As `vsh.io.catalogue.match` does.
    ConvergenceError
        If clipping leaves too few.
    ParameterError
        If there are not two labels.

    Notes
    -----
    Errors of the two are taken as independent: of catalogues that share observations (ICRF2 and ICRF3 do) the
    differences scatter less than the sum of their errors, and the errors printed are too large. Charlot et al. (2020,
    A&A 644, A159) compare ICRF3 with ICRF2 like this.
    """
    if len(labels) != 2 or not all(isinstance(label, str) for label in labels):
        raise ParameterError(f"labels are two names, not {labels!r}")
    modes = as_modes(modes)
    pairs = counterparts(a, b, by=by, radius=radius)
    differences = match(a, b, by=by, pairs=pairs)
    unit = "µas" if isinstance(a, Positions) else "µas/yr"
    # A few that are off by thousands of errors would carry a first fit away: none of them goes into it.
    near = np.ones(len(differences), bool)
    if differences.motion.any():  # a catalogue beside itself has no scatter
        near = _distances(student_t(differences, modes).solution, differences) <= _FAR * threshold
    clipped = clip(differences[near] if near.any() else differences, modes, threshold=threshold)
    solution = replace(clipped.solution, unit=unit)
    kept = near.copy()
    kept[near] = clipped.kept
    far = _distances(clipped.solution, differences)
    order = np.flatnonzero(~kept)[np.argsort(-far[~kept], kind="stable")]
    called = differences.name if differences.name is not None else np.arange(len(differences))
    fitted = differences[kept]
    sources = [_with_own_errors(each, chosen[kept], fitted) for each, chosen in ((a, pairs.a), (b, pairs.b))]
    comparison = FrameComparison(
        (labels[0], labels[1]),
        solution,
        tuple(str(called[i]) for i in order),
        differences.motion[:, order].T,
        far[order],
        solution.quality.factor,
        correlation_matrices(sources, modes.lmax, labels=list(labels)),
    )
    return comparison, fitted


def _distances(solution, field):
    return np.sqrt(solution.residuals(field).chi2)


def _with_own_errors(catalogue, chosen, kept):
    """The sources that were fitted, with the errors of one catalogue."""
    return kept.minus(kept.motion).with_errors(catalogue.sigma[:, chosen], catalogue.rho[chosen])


__getattr__ = old_names(__name__, {"compare": "compare_catalogues"})
