"""Two catalogues of one sky: how one frame is turned, drifts and is deformed against the other."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from fit.background import ClassComparison, Floor, shared
from fit.background import floor as background_floor
from fit.correlation import CorrelationMatrices, correlation_matrices
from fit.frames.results import FrameResult
from fit.methods import METHODS
from fit.normal import add_coverage_notes, fit_field, normal_equations
from fit.results.quality import FEW, MANY, SEEN, ErrorSource, f_p_value
from fit.results.solution import AboutSolution, Solution
from fit.robust import clip, student_t
from vsh.conventions import ICRF3, to_icrf3_terms
from vsh.field import Field
from vsh.io import tables
from vsh.io.catalogue import counterparts, match
from vsh.io.sections import Answer, Section
from vsh.models.covariance import Covariance, of_errors
from vsh.modes import Modes, as_modes
from vsh.sky.frames import Positions
from vsh.tools import arguments
from vsh.tools.digits import format_p_value, format_with_error
from vsh.tools.errors import ParameterError, VshError
from vsh.tools.notebook import Frozen
from vsh.tools.printing import one_line_text
from vsh.tools.types import FloatArray, IntArray, Rng, Table
from vsh.vector import Vector, chance_probability

__all__ = ["FrameComparison", "compare_catalogues"]
#: Outliers that the report lists.
_MOST_LISTED, _FEW_LISTED = 10, 3
#: What is so many times farther than the limit from a robust fit is left out before the first plain one.
_FAR_RATIO = 3.0
#: The degree that it is looked for to.
_FLOOR_DEGREE = 5
#: Classes of quoted error, and the fewest sources in one.
CLASSES, FEWEST = 5, 30
#: The nside of the blocks that are left out one by one.
_BLOCK_NSIDE = 2


#: What may be fitted alone, by its kind of coefficients: rotation, the glide, or nothing beside all degrees.
PARAMETERS = {"orientation": "T", "spin": "T", "glide": "S", "degree": ""}
#: Where values and errors may come from.
_METHODS = ("least-squares", "student", "excess-noise", "bootstrap", "jackknife")


@dataclass(frozen=True, eq=False)
class ErrorClassFit(Frozen):
    """A fit with errors scaled in classes of their size: what a catalogue shares with another changes with it.

    Attributes
    ----------
    values, covariance : (p,) and (p, p) arrays
        Coefficients and their covariance.
    factors : tuple of float
        On the errors of each class, the smallest errors first.
    p_value : float
        Probability of as much beyond degree 1; nan where nothing was fitted there.
    """

    values: FloatArray
    covariance: FloatArray
    factors: tuple[float, ...]
    p_value: float


def fit_by_error_class(differences: Field, modes: Modes, indices: IntArray | None = None) -> ErrorClassFit | None:
    """Fit differences with a factor on the errors of each of five classes of quoted error; None where residuals vanish.

    Only the coefficients `indices` are fitted, the others held at zero.

    The factors are χ² of each class over the degrees of freedom that the fit leaves it, the coefficients common to all.
    One factor for all sources is wrong where the faint share noise and the bright do not.
    """
    n = len(differences)
    indices = np.arange(len(modes)) if indices is None else indices
    p = len(indices)
    n_classes = max(1, min(CLASSES, n // max(FEWEST, 2 * p)))
    if 2 * n <= p:
        return None
    order = np.argsort(np.sum(differences.sigma**2, axis=0), kind="stable")
    normals = [normal_equations(differences[np.sort(members)], modes) for members in np.array_split(order, n_classes)]
    normals = [replace(e, matrix=e.matrix[np.ix_(indices, indices)], rhs=e.rhs[indices]) for e in normals]
    tau = np.ones(n_classes)
    for _ in range(6):
        matrix = sum((normal.matrix / t for normal, t in zip(normals, tau, strict=True)), np.zeros((p, p)))
        rhs = sum((normal.rhs / t for normal, t in zip(normals, tau, strict=True)), np.zeros(p))
        covariance = np.linalg.inv(matrix)
        values = covariance @ rhs
        chi2 = np.array([e.chi2_null - 2 * e.rhs @ values + values @ e.matrix @ values for e in normals])
        dof = np.array([e.n_data - np.sum(covariance * e.matrix) / t for e, t in zip(normals, tau, strict=True)])
        reduced_chi2 = chi2 / dof
        if not (reduced_chi2 > 1e-12).all():
            return None
        tau = reduced_chi2
    is_deformation = modes.degrees[indices] > 1
    p_value = float("nan")
    if is_deformation.any():
        deformation = values[is_deformation]
        norm2 = deformation @ np.linalg.solve(covariance[np.ix_(is_deformation, is_deformation)], deformation)
        weight_share = np.array([np.trace(e.matrix) / t for e, t in zip(normals, tau, strict=True)])
        weight_share /= weight_share.sum()
        p_value = f_p_value(float(norm2), int(is_deformation.sum()), 1 / np.sum(weight_share**2 / dof))
    return ErrorClassFit(values, np.asarray(covariance, float), tuple(map(float, np.sqrt(tau))), float(p_value))


def count_same_values(differences: Field) -> int:
    """Count the sources that have the same values in both catalogues."""
    absolute_differences = abs(differences.motion)
    is_near = (absolute_differences < 1e-3 * differences.sigma).all(axis=0)
    limit = 0.01 * np.median(absolute_differences[:, ~is_near]) if (~is_near).any() else np.inf
    return int((is_near & (absolute_differences < limit).all(axis=0)).sum())


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrameComparison(FrameResult, AboutSolution):
    """Comparison of two catalogues.

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
    by_class : ErrorClassFit or None
        The same fit with errors scaled in classes of their size, each by its own residuals.
    shared : ClassComparison or None
        Rotation and glide with systematic errors, where that was asked for.
    floor : Floor or None
        The size of systematic errors, where it is in no error above.
    alone : ErrorClassFit or None
        Rotation or glide alone, the rest held at zero, where that was asked for.
    alone_names : tuple of str
        Its coefficients, by names of the ICRF3 papers.
    method : str
        How errors of `solution` were made: "" as quoted, or what was asked for in place of them.
    n_same : int
        How many sources have the same values in both catalogues: to a thousandth of their errors, and to a hundredth of
        what the others differ by, for errors may be in a wrong unit.
    """

    labels: tuple[str, str]
    solution: Solution
    names: tuple[str, ...]
    offsets: FloatArray
    distances: FloatArray
    factor: float
    correlations: CorrelationMatrices
    by_class: "ErrorClassFit | None" = None
    shared: ClassComparison | None = None
    floor: Floor | None = None
    alone: "ErrorClassFit | None" = None
    alone_names: tuple[str, ...] = ()
    method: str = ""
    n_same: int = 0

    def __repr__(self) -> str:
        counts = f"{self.solution.n_sources} sources, {len(self.names)} left out"
        return f"<FrameComparison: {' − '.join(self.labels)}, {counts}>"

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Coefficients with errors, by names and signs of the ICRF3 papers to degree 2 and by those of modes beyond."""
        return to_icrf3_terms(self.solution.coefficients, self.solution.sigma)

    @property
    def parameters_alone(self) -> dict[str, tuple[float, float]]:
        """Rotation or glide with the rest held at zero, by names and signs of the ICRF3 papers; empty unless asked."""
        if self.alone is None:
            return {}
        sigma = np.sqrt(np.diag(self.alone.covariance))
        return {
            name: (float(value / ICRF3[name][1]), float(error / abs(ICRF3[name][1])))
            for name, value, error in zip(self.alone_names, self.alone.values, sigma, strict=True)
        }

    @cached_property
    def best(self) -> Solution:
        """The solution with the errors of the verdict: in classes, and of rotation and glide with systematic errors.

        Where sources share errors, the covariance of rotation and glide with the higher degrees is that of their noise:
        systematic errors add to the variances alone.
        """
        solution, errors = self.solution, self.solution.errors_from
        error_source = solution.error_source
        values, covariance = np.array(solution.values), np.array(solution.covariance)
        if self.by_class is not None:
            values, covariance = np.array(self.by_class.values), np.array(self.by_class.covariance)
            errors = "the scatter of the residuals in classes of sources with similar formal errors"
            error_source = ErrorSource.RESIDUALS
        degree_one = np.flatnonzero(solution.modes.degrees == 1)
        if self.shared is not None:
            shared_solution = self.shared.solutions[0]
            values[degree_one] = shared_solution.values
            block = np.ix_(degree_one, degree_one)
            noise_block, covariance[block] = covariance[block], shared_solution.covariance
            if np.linalg.eigvalsh(covariance)[0] <= 0:  # errors are smaller where systematic errors are held back
                root_ratio = np.linalg.cholesky(covariance[block]) @ np.linalg.inv(np.linalg.cholesky(noise_block))
                higher = np.flatnonzero(solution.modes.degrees > 1)
                covariance[np.ix_(degree_one, higher)] = root_ratio @ covariance[np.ix_(degree_one, higher)]
                covariance[np.ix_(higher, degree_one)] = covariance[np.ix_(degree_one, higher)].T
            errors += "; those of rotation and glide include systematic errors"
        elif self.floor is not None:
            covariance += np.diag(self.floor.added(solution.modes))
            spin, glide = self.floor.spin_error, self.floor.acceleration_error
            errors += f"; systematic floor included (rotation ± {spin:.3g}, glide ± {glide:.3g} {solution.unit})"
        elif solution.n_sources < FEW:
            errors += f"; without systematic errors: of fewer than {FEW} sources they are not known, and floor=True "
            errors += "(--floor) includes those of the higher degrees"
        else:
            errors += "; without systematic errors"
        return replace(
            solution,
            coefficients=replace(solution.coefficients, values=values),
            covariance=covariance,
            errors_from=errors,
            error_source=error_source,
            includes_floor=solution.includes_floor or self.shared is not None or self.floor is not None,
            formal_covariance=solution.formal.covariance,
        )

    @property
    def quoted(self) -> Solution:
        """The solution to quote, `best`."""
        return self.best

    @property
    def answer(self) -> Answer:
        """The result to quote: rotation, glide, whether one frame is deformed against the other, and the errors.

        There is none where most sources have the same values in both catalogues.
        """
        if 2 * self.n_same > self.solution.n_sources:
            copied = f"{self.n_same} of {self.solution.n_sources} sources have the same values in both catalogues"
            return Answer((("no comparison", f"{copied}: one has taken them from the other"),))
        lines = list(super().answer.lines)
        p = self.deformation_p_value if self.by_class is None else self.deformation_p_value_by_class
        if np.isfinite(p):
            lines.append(("deformation", f"{'' if p < SEEN else 'not '}detected, p = {format_p_value(p)}"))
        return Answer((*lines, ("errors", f"from {self.best.errors_from}")))

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Notes of the solution, for the reader."""
        return self.solution.notes

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The first catalogue, less the second."""
        return (self.labels,)

    def vectors(self, one: str | None = None, two: str | None = None) -> dict[str, Vector]:
        """Rotation and glide with the errors of the result, by name.

        Parameters
        ----------
        one, two : str, optional
            The two catalogues, the second subtracted from the first; or neither.

        Raises
        ------
        ParameterError
            If they are not those that were compared.
        """
        if one == two is not None or {one, two} - {*self.labels, None}:
            raise ParameterError(f"the catalogues are {' and '.join(self.labels)}, not {one} and {two}")
        sign = -1 if one == self.labels[1] or two == self.labels[0] else 1
        vectors = {"rotation": self.best.spin, "glide": self.best.acceleration}
        return {name: replace(vector, value=sign * vector.value) for name, vector in vectors.items()}

    @property
    def deformation_p_value_by_class(self) -> float:
        """Probability of as much beyond rotation and glide, with errors scaled in classes of their size.

        This is the one that holds: on simulated pairs of 150 and 500 sources with nothing, half or nine tenths of the
        noise shared, by all alike, by the bright or by the faint alone, 0.05 comes out on 1 to 8 %
        (benchmarks/shared_noise.py). The noise there is Gaussian: with tails of Student's t of three degrees of freedom
        and sources beyond the threshold left out, it comes out on 9 % (500 sources) to 16 % (40).
        """
        return float("nan") if self.by_class is None else self.by_class.p_value

    @property
    def deformation_p_value(self) -> float:
        """P-value of the deformation with formal errors: the probability of as large a one from noise alone.

        It is right if the errors are right and the two catalogues have no common noise. With common noise it is too
        large: with half of the noise common, it was below 0.05 on no simulated sky. With another method than least
        squares it is Hotelling's, of the errors by that method: below 0.05 on 0 to 2 % of skies without a deformation,
        with 20 to 100 sources whose errors differ by factors of two (student, excess-noise, bootstrap), on 0 to 10 % by
        the jackknife.
        """
        return self._compute_deformation_p_value(1.0)

    @property
    def deformation_p_value_scaled(self) -> float:
        """P-value of the deformation with errors multiplied by `factor`, which residuals suggest.

        Right where noise is shared, or errors are wrong, by one factor for all sources. Where the faint share and the
        bright do not, or errors are wrong by more for some, neither is: with all noise of the fainter half shared 0.05
        came out on up to 46 % of skies.
        """
        return self._compute_deformation_p_value(self.factor)

    def _compute_deformation_p_value(self, error_factor):
        indices = np.flatnonzero(self.solution.modes.degrees > 1)
        if not indices.size:
            return float("nan")
        values, covariance = self.solution.values[indices], self.solution.covariance[np.ix_(indices, indices)]
        chi2, n_terms = float(values @ np.linalg.solve(covariance, values)), indices.size
        if self.method:  # errors are of the scatter already, and their degrees of freedom are known
            return chance_probability(chi2, n_terms, self.solution.covariance_dof)
        dof = self.solution.dof if error_factor != 1 else np.inf  # the factor is an estimate
        return f_p_value(chi2 / error_factor**2, n_terms, dof)

    def _sections(self, long):
        solution, (label_a, label_b), best, parameters = self.solution, self.labels, self.best, self.parameters
        terms = to_icrf3_terms(best.coefficients, best.sigma)
        term_names = [name for name in terms if long or name[0] in "RD"]
        values, errors = np.transpose([terms[name] for name in term_names])
        columns = {"ICRF3 term": term_names, "value": values, "sigma": errors, "value / error": values / errors}
        columns["formal error"] = [parameters[name][1] for name in term_names]
        table = tables.table_of(columns, {}, dict.fromkeys(("value", "sigma", "formal error"), solution.unit))
        facts = [("sources", f"{solution.n_sources}, {len(self.names)} excluded"), *self._list_error_facts(long)]
        rotation = "R1, R2, R3 are the components of the rotation with the opposite sign"
        remarks = [f"{rotation}, because they rotate the axes and not the sources."]
        if self.alone is not None:
            text = ", ".join(f"{name} {format_with_error(v, s, '+')}" for name, (v, s) in self.parameters_alone.items())
            remarks.append(f"These alone, all others held at zero (errors scaled in classes): {text} {solution.unit}")
        if self.names and not long:
            nearest = zip(self.names[:_FEW_LISTED], self.distances, strict=False)
            outliers = ", ".join(f"{one_line_text(name)} ({x:.1f} standard errors)" for name, x in nearest)
            remarks.append(f"Largest deviations among the {len(self.names)} excluded sources: {outliers}")
        quantity = "position" if solution.unit == "µas" else "motion"
        notes = () if long else solution.notes
        forms = {"value / error": "+z.1f", "formal error": ".2f"}
        title = f"{label_a} − {label_b}: differences of {quantity}"
        sections = [Section(title, facts, table, forms=forms, remarks=remarks, notes=notes)]
        if long and self.names:
            outliers = self.outliers_table()[:_MOST_LISTED]
            outliers.rename_columns(["name", "distance"], ["source", "errors"])
            forms = dict.fromkeys(("east", "north", "errors"), ".1f")
            title = f"Largest deviations, of {len(self.names)} excluded sources"
            sections.append(Section(title, (), outliers, forms=forms))
        if long:
            sections += self.shared.sections(long=True) if self.shared is not None else ()
            sections += best.sections(long=True)
        return tuple(sections)

    def _list_error_facts(self, long):
        """List facts on the errors: their source and what they leave out."""
        solution, facts = self.solution, []
        if self.method:
            facts.append(("method", f"{self.method}, its formal errors beside"))
        if self.by_class is not None and long:
            factors = ", ".join(f"{factor:.2f}" for factor in self.by_class.factors)
            n_classes = len(self.by_class.factors)
            classes = f"{n_classes} classes of similar formal errors" if n_classes > 1 else "one class"
            facts.append(
                ("errors", f"rescaled by the scatter of residuals in {classes}, by {factors} from the smallest on")
            )
        if solution.modes.lmax > 1 and long:
            p_value = self.deformation_p_value_by_class
            p_values = [f"{format_p_value(p_value)} with errors rescaled in classes"] * bool(np.isfinite(p_value))
            errors = f"errors by {self.method}" if self.method else "formal errors"
            p_values.append(f"{format_p_value(self.deformation_p_value)} with {errors}")
            if self.factor != 1 and not self.method:
                p_values.append(f"{format_p_value(self.deformation_p_value_scaled)} with formal errors times a factor")
            facts.append(("deformation", f"degrees 2 to {solution.modes.lmax}, p = {'; '.join(p_values)}"))
        if self.factor != 1:
            phrase = f"their scatter is {self.factor:.3g} times the formal errors"
            if self.factor < 1:
                phrase += (
                    ": the catalogues have observations in common, or the formal errors are too large; errors common "
                    "to both catalogues cancel in the differences and are not included"
                )
            facts.append(("residuals", phrase))
        if self.shared is not None:
            facts.append(("R and D", "errors include systematic errors, estimated from degrees 2 to 5"))
        if self.floor is not None and long:
            spin, glide = self.floor.spin_error, self.floor.acceleration_error
            phrase = f"rotation ± {spin:.3g}, glide ± {glide:.3g} {solution.unit}, included in the errors of R and D; "
            facts.append(("floor", f"{phrase}estimated from degrees 2 to {max(self.floor.degrees)}, for each parity"))
        for label, index in zip(self.labels, (0, 1), strict=True) if long else ():
            value, pair = self.correlations.largest(index)
            facts.append((f"errors of {label}", f"largest correlation {value:+.3f}, of {pair[0]} and {pair[1]}"))
        return facts

    def parameters_table(self) -> Table:
        """`parameters` as the report has them, a row each: with the errors of the verdict, and as quoted."""
        values, errors = np.transpose(list(self.parameters.values()))
        columns: dict[str, Any] = {"ICRF3": list(self.parameters)}
        best = self.best
        columns["value"], columns["sigma"] = np.transpose(list(to_icrf3_terms(best.coefficients, best.sigma).values()))
        columns |= {"value_formal": values, "sigma_formal": errors}
        columns["in_errors"] = columns["value"] / columns["sigma"]
        units = {name: self.solution.unit for name in columns if name.startswith(("value", "sigma"))}
        return tables.table_of(columns, {"frame": self.solution.frame, "summary": self.verdict}, units)

    def outliers_table(self) -> Table:
        """A row for each source that was left out, as an astropy Table."""
        east, north = self.offsets.T
        columns = {"name": np.array(self.names, dtype=str), "east": east, "north": north, "distance": self.distances}
        units = dict.fromkeys(("east", "north"), self.solution.unit)
        return tables.table_of(columns, {"frame": self.solution.frame}, units)


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
    floor: bool | None = None,
    parameters: Literal["orientation", "spin", "glide", "degree"] = "degree",
    method: Literal["least-squares", "student", "excess-noise", "bootstrap", "jackknife"] = "least-squares",
    replicates: int = 1000,
    rng: Rng = 1,
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
    floor : bool, optional
        Whether rotation and glide are also given with systematic errors, from the power of
        degrees 2 to 5 of the differences; unless given, so from 100 000 sources on, and below that the size of the
        systematic floor is added to their errors. False leaves systematic errors out.
    parameters : {"degree", "orientation", "spin", "glide"}
        What is also fitted alone, the rest held at zero: the rotation (of positions an orientation, of motions a spin),
        or the glide. Few sources with large errors invent the rest.
    method : {"least-squares", "student", "excess-noise", "bootstrap", "jackknife"}
        The estimator, one of `fit.METHODS`, of what is not left out; least squares has errors that are scaled in
        classes of their size.
    replicates : int
        How many resamplings the bootstrap makes.
    rng : Generator or int
        The source of all randomness: of that and the bootstrap.

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
        raise ParameterError(f"labels= are two names, not {labels!r}")
    arguments.choice("parameters", parameters, tuple(PARAMETERS))
    arguments.choice("method", method, _METHODS)
    modes = as_modes(modes)
    pairs = counterparts(a, b, by=by, radius=radius)
    differences = match(a, b, by=by, pairs=pairs)
    unit = "µas" if isinstance(a, Positions) else "µas/yr"
    # A few that are off by thousands of errors would carry a first fit away: none of them goes into it.
    is_near, scatter = np.ones(len(differences), bool), np.ones(len(differences))
    if differences.motion.any():  # a catalogue beside itself has no scatter
        residuals = _compute_normalised_residuals(student_t(differences, modes).solution, differences)
        scatter = _estimate_scatter_by_class(residuals, differences)
        is_near = residuals <= _FAR_RATIO * threshold * scatter
    scaled_differences = differences.with_errors(differences.sigma * scatter, differences.rho)
    clipping = clip(scaled_differences[is_near] if is_near.any() else scaled_differences, modes, threshold=threshold)
    selection = is_near.copy()
    selection[is_near] = clipping.kept
    formal_solution = clipping.solution
    if (scatter > 1).any():
        fits = (fit_field(field[selection], modes) for field in (scaled_differences, differences))
        formal_solution = _restore_given_errors(formal_solution, *fits)
    distances = _compute_normalised_residuals(formal_solution, differences)
    outlier_rows = np.flatnonzero(~selection)[np.argsort(-distances[~selection], kind="stable")]
    source_names = differences.name if differences.name is not None else np.arange(len(differences))
    fitted = differences[selection]
    fields = [_apply_own_errors(each, indices[selection], fitted) for each, indices in ((a, pairs.a), (b, pairs.b))]
    has_covariance = [getattr(catalogue, "covariance", None) is not None for catalogue in (a, b)]
    covariance = None
    if any(has_covariance):
        if method != "least-squares" or parameters != "degree":
            asked = method if method != "least-squares" else f"the {parameters} alone"
            raise ParameterError(
                f"{asked} weighs sources one by one, and {labels[has_covariance.index(True)]} has a covariance between "
                'them: least squares of whole degrees uses it, method="least-squares", parameters="degree" '
                "(--method least-squares --parameters degree)"
            )
        covariance = _sum_covariances((a[pairs.a[selection]], b[pairs.b[selection]]), fields)
        formal_solution = _solve_with_covariance(fitted, modes, covariance)
    estimate = _solve_by_method(fitted, modes, method, replicates, rng) or formal_solution
    notes = list(add_coverage_notes(estimate, fitted).notes)
    if (scatter > 1.2).any():
        notes.append(
            "sources are excluded by errors up to "
            f"{scatter.max():.3g} times those given, as half of the residuals in classes of similar errors suggest"
        )
    if not is_near.all():
        notes.append(
            f"{int((~is_near).sum())} of {len(is_near)} pairs deviate by more than {_FAR_RATIO * threshold:g} standard "
            "errors from a robust fit: excluded before the first least-squares fit"
        )
    n_same = count_same_values(fitted)
    if 100 * n_same > len(fitted):  # one in a million if catalogues are independent
        notes.append(f"{n_same} of {len(fitted)} sources have the same values in both catalogues")
    solution = replace(estimate, unit=unit, notes=tuple(notes))
    names = tuple(name for name, (mode, _) in ICRF3.items() if mode.l == 1 and mode.kind in PARAMETERS[parameters])
    indices = np.array([modes.index(ICRF3[name][0]) for name in names], int)
    comparison = FrameComparison(
        labels=(labels[0], labels[1]),
        solution=solution,
        names=tuple(str(source_names[i]) for i in outlier_rows),
        offsets=differences.motion[:, outlier_rows].T,
        distances=distances[outlier_rows],
        factor=1.0 if solution.error_source == ErrorSource.SCALED else solution.quality.factor,
        correlations=correlation_matrices(fields, modes.lmax, labels=list(labels)),
        by_class=fit_by_error_class(fitted, modes) if method == "least-squares" and not any(has_covariance) else None,
        alone=fit_by_error_class(fitted, modes, indices) if names else None,
        alone_names=names,
        method="" if method == "least-squares" else method,
        n_same=n_same,
    )
    return _add_systematic_errors(comparison, fitted, floor, replicates, rng, covariance), fitted


def _sum_covariances(catalogues, fields):
    """Covariance of the differences, with what sources have in common in one catalogue or both."""
    covariances = [
        of_errors(field) if getattr(catalogue, "covariance", None) is None else Covariance(catalogue.covariance)
        for catalogue, field in zip(catalogues, fields, strict=True)
    ]
    return covariances[0] + covariances[1]


def _solve_with_covariance(fitted, modes, covariance):
    """The fit with a covariance between sources, with larger errors where χ² asks for it."""
    solution = fit_field(fitted, modes, covariance=covariance)
    scaled = solution.scaled if solution.quality.factor > 1 else solution
    return replace(scaled, errors_from=scaled.errors_from.replace("the catalogue", "the covariance between sources"))


def _restore_given_errors(clipped, scaled, formal):
    """The fit of what clipping by scaled errors left, with the errors given and what clipping does to them and χ²."""
    chi2_ratio, variance = scaled.chi2 / clipped.chi2, np.trace(clipped.covariance) / np.trace(scaled.covariance)
    return replace(formal, covariance=formal.covariance * variance, chi2=formal.chi2 / chi2_ratio, notes=clipped.notes)


def _estimate_scatter_by_class(residuals, differences):
    """Factor on the errors of each source, one at least, from the median residual of sources with similar errors.

    Sources with errors three times too small would be outliers by those, and the rest scatter less than the noise.
    """
    order = np.argsort(np.sum(differences.sigma**2, axis=0), kind="stable")
    factors = np.ones(len(order))
    for members in np.array_split(order, max(1, min(CLASSES, len(order) // FEWEST))):
        factors[members] = max(1.0, np.median(residuals[members]) / np.sqrt(2 * np.log(2)))
    return factors


def _solve_by_method(fitted, modes, method, replicates, rng):
    """The solution by one of `fit.METHODS`; None of least squares."""
    if method in ("", "least-squares"):
        return None
    return METHODS[method](fitted, modes, {"bootstrap": replicates, "jackknife": _BLOCK_NSIDE}.get(method), rng).plain


def _add_systematic_errors(comparison, fitted, floor, replicates, rng, covariance):
    """The comparison with systematic errors in its errors, or its size beside them.

    The size is added to a covariance between sources, of which `shared` knows nothing.
    """
    is_shared = covariance is None and (len(fitted) >= MANY if floor is None else floor)
    if floor is False or (floor is None and not is_shared and len(fitted) < FEW):
        return comparison
    floor_modes = as_modes(max(_FLOOR_DEGREE, comparison.solution.modes.lmax))
    source = _solve_by_method(fitted, floor_modes, comparison.method, replicates, rng) or normal_equations(
        fitted, floor_modes, covariance=covariance
    )
    if is_shared:
        shared_errors = shared([source], range(2, _FLOOR_DEGREE + 1), labels=[" − ".join(comparison.labels)], rng=rng)
        return replace(comparison, shared=replace(shared_errors, unit=comparison.solution.unit))
    with suppress(VshError):  # without noise, or on too little of the sky, there is none to be known
        floor_estimate = background_floor(source, range(2, _FLOOR_DEGREE + 1))
        if np.isfinite([floor_estimate.spin_error, floor_estimate.acceleration_error]).all():
            return replace(comparison, floor=floor_estimate)
    return comparison


def _compute_normalised_residuals(solution, field):
    return np.sqrt(solution.residuals(field).chi2)


def _apply_own_errors(catalogue, indices, differences):
    """The sources that were fitted, with the errors of one catalogue."""
    return differences.minus(differences.motion).with_errors(catalogue.sigma[:, indices], catalogue.rho[indices])
