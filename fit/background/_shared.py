"""Systematic errors of classes of sources: bins of redshift, magnitudes, halves of the sky, catalogues, in one model.

Each class has a spin and an acceleration of its own; degrees 2 and higher contain nothing but systematic errors, which
are common to all classes or each one's own in a proportion that the data determine. Errors of
degree 1, and of differences of classes, follow.

A class that does not see the whole sky takes systematics of higher degrees for its own lower ones: on two caps beyond
latitude 40° degrees 6 to 16 put 170 times the power of degree 1 into it. Where the normal equations hold degrees beyond
those in which something shared is looked for, these have a prior of the power that the class has by a first estimate,
and are marginalised (`fit.normal.eliminate`), class by class. If two classes cover the same part of the sky, the part
of these modes that they have in common would cancel in their difference; marginalised separately, it makes the errors
of differences larger than necessary.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from fit.background._blocks import (
    MIN_EFFECTIVE_DRAWS,
    ClassEquations,
    ShapeDraws,
    compute_condition_number,
    map_parities,
    reduce_class_equations,
    resample_draws,
    sample_amplitudes_by_shape,
)
from fit.background._floor import SCALAR_SHAPES, SHAPES, list_shapes
from fit.background._likelihood import equations_of, format_degrees, should_fit_scale
from fit.normal import NormalEquations, eliminate
from fit.results.output import format_components
from fit.results.quality import ErrorSource, gls
from fit.results.solution import ScalarSolution, Solution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Section
from vsh.models.covariance import ScalarSpectrum, Spectrum, SpectrumOfKind
from vsh.modes import Modes
from vsh.tools.arguments import choice, generator, whole
from vsh.tools.digits import format_with_error
from vsh.tools.errors import DegeneracyError, FrameError, ModesError, ParameterError
from vsh.tools.parallel import limit_blas
from vsh.tools.printing import log_calls
from vsh.tools.types import ArrayLike, AxesArray, BoolArray, FloatArray, OnAxes, Rng, Table

#: Beyond this condition of its normal matrix a class takes higher degrees for lower ones: the sky outside the Galactic
#: plane has 14 at degree 5, two caps beyond latitude 40° have 1300.
PART_SKY_CONDITION = 100.0
#: Equations of so many degrees more allow for that.
EXTRA_DEGREES = 3
#: Beyond this condition of its normal matrix a class sees too little of the sky to separate degrees.
_MAX_CONDITION = 1e5


class Verdict(NamedTuple):
    """Test of whether classes differ, after allowing for all comparisons.

    Attributes
    ----------
    p_value : float
        The p-value of the largest difference, among as many as were looked at.
    face_value : float
        The p-value of the same difference without a correction for the number of comparisons.
    comparison : str
        Name of the comparison with the largest difference.
    looked_at : int
        How many were looked at.
    """

    p_value: float
    face_value: float
    comparison: str
    looked_at: int


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClassComparison(Result):
    """Spin and acceleration of classes of sources, with their common systematic errors.

    Attributes
    ----------
    labels : tuple of str
        The classes.
    means, covariances : (s, K, f) and (s, K, f, K, f) arrays
        Degree 1 of each class (T, then S) for draws of equal weight of the systematic errors, f = 6; degrees 0 and 1 of
        a scalar field, f = 4.
    shares : (s, 2, K, K) array
        C of these draws: the power of each mode that classes have in common, of the parity of a spin and of a glide;
        (s, 1, K, K) of a scalar field.
    shapes : tuple of str
        Shapes of the spectrum that were averaged.
    probability : tuple of float
        How probable each shape is, with odds of three to one for Gaia's a priori.
    effective : tuple of float
        Effective number of draws for each shape.
    degrees : tuple of int
        Degrees from which the systematic errors were estimated.
    noise_scale : tuple of float
        Factor on the errors of each class.
    n_sources : tuple of int
    frame : str
    notes : tuple of str
    templates : tuple of str
        Names of the templates, cut to the highest degree.
    amplitudes, amplitude_covariance : (t,) and (t, t) arrays
        How much of each is in the motions, the same in all classes, beside the systematic errors; rms over the sky,
        of the degrees that are used. Free a priori: nothing shrinks them. [`unit`]
    unit : str
        "µas/yr" of motions, "µas" of positions.
    made_by : str
        Quantity that defines the classes, as the verdict names it: "redshift" for bins.
    """

    labels: tuple[str, ...]
    means: FloatArray
    covariances: FloatArray
    shares: FloatArray
    shapes: tuple[str, ...]
    probability: tuple[float, ...]
    effective: tuple[float, ...]
    degrees: tuple[int, ...]
    noise_scale: tuple[float, ...]
    n_sources: tuple[int, ...]
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    templates: tuple[str, ...] = ()
    amplitudes: FloatArray = field(default_factory=partial(np.zeros, 0))
    amplitude_covariance: FloatArray = field(default_factory=partial(np.zeros, (0, 0)))
    unit: str = "µas/yr"
    made_by: str = "class"

    def __len__(self) -> int:
        return len(self.labels)

    def __repr__(self) -> str:
        return f"<ClassComparison: {len(self)} classes, degrees {format_degrees(self.degrees)}>"

    @property
    def parameters(self) -> dict[str, tuple[str, slice]]:
        """Names of what each class has, and its place among the f parameters, by kind: spin of "T", say."""
        if self.means.shape[2] == 4:
            return {"mean": ("mean", slice(0, 1)), "dipole": ("dipole", slice(1, 4))}
        return {"T": ("spin", slice(0, 3)), "S": ("acceleration", slice(3, 6))}

    @property
    def values(self) -> FloatArray:
        """Degree 1 of each class, the mean over what may be shared, (K, f). [`unit`]"""
        return self.means.mean(0)

    @property
    def covariance(self) -> FloatArray:
        """Covariance of degree 1 of all classes, (f K, f K). [square of `unit`]"""
        size = self.values.size
        return pool_draw_covariances(self.means, self.covariances).reshape(size, size)

    @property
    def solutions(self) -> list[Solution]:
        """A Solution of degree 1 for each class, its errors with systematic errors."""
        return [self.combination(np.eye(len(self))[i]) for i in range(len(self))]

    def difference(self, i: int, j: int) -> Solution:
        """Degree 1 of class `j` less that of class `i`, with its errors."""
        return self.combination(np.eye(len(self))[j] - np.eye(len(self))[i])

    def together(self) -> Solution:
        """Fit one spin and acceleration to all classes, by generalised least squares."""
        values, _, covariance = gls(self.values, self.covariance, np.ones((len(self), 1)))
        return self._make_degree_one_solution(values, covariance, sum(self.n_sources))

    def equality(self, kind: str | None = None) -> float:
        """p-value of equal dipoles in all classes, averaged over the posterior of the common systematic errors.

        Parameters
        ----------
        kind : {"T", "S"} or {"mean", "dipole"}, optional
            The spin or the acceleration alone; the mean or the dipole of a scalar field.
        """
        return self._compute_change_p_value(kind, None)

    def p_value(self, kind: str, i: int = 0, less: int | None = None) -> float:
        """p-value of the spin or the acceleration of a class, or of its difference from another class.

        It is averaged over the posterior of the common systematic errors, whose size is unknown: benchmarks/referee.py
        measures how often it is small.

        Parameters
        ----------
        kind : {"T", "S"} or {"mean", "dipole"}
            The spin or the acceleration; the mean or the dipole of a scalar field.
        i : int
            Number of the class.
        less : int, optional
            Number of another that is subtracted: whether the two are alike.
        """
        block = self._select_kind_slice(kind)
        row = np.eye(len(self))[i] - (0 if less is None else np.eye(len(self))[less])
        return compute_contrast_p_value(self.means[:, :, block], self.covariances[:, :, block][..., block], row[None])

    def trend(self, x: Iterable[float] | None = None, kind: str | None = None) -> float:
        """p-value of no slope along the classes.

        Parameters
        ----------
        x : (K,) numbers, optional
            Where each class stands; 0, 1, 2, … unless given.
        kind : {"T", "S"}, optional
            The spin or the acceleration alone.

        Raises
        ------
        ParameterError
            If there is not one number a class, or they are all the same.
        """
        positions = np.arange(len(self), dtype=float) if x is None else np.asarray(list(x), float)
        if positions.shape != (len(self),) or not np.ptp(positions) > 0:
            raise ParameterError(f"a trend needs a place for each of {len(self)} classes, not all the same")
        return self._compute_change_p_value(kind, positions)

    def verdict(self, n: int = 4000, rng: Rng = 1) -> Verdict:
        """Test whether the dipole changes along the classes: the largest difference, after allowing for the search.

        The comparisons are the difference across each edge between neighbouring classes, and a slope along the classes,
        for spin and for acceleration. The distribution of the largest is simulated with classes that have the same
        dipole, and systematic errors from the posterior.

        Parameters
        ----------
        n : int
            Skies that are drawn.
        rng : Generator or int
            The source of all randomness.
        """
        random, size = generator(rng), self.values.size
        skies_per_draw = max(1, whole("n", n) // len(self.means))
        skies = [self.values.reshape(1, size)]
        for covariance in self.covariances.reshape(-1, size, size):
            root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(size))
            skies.append(random.normal(size=(skies_per_draw, size)) @ root.T)
        class_values = np.concatenate(skies).reshape(-1, *self.values.shape)
        p_values, ranks, contrast_names = [], [], []
        for row, kind, contrast_name in self._make_contrasts():
            block = self._select_kind_slice(kind)
            contrast_covariance = np.einsum("i,iajb,j->ab", row, self._fold_covariance()[:, block][:, :, :, block], row)
            differences = np.einsum("i,nia->na", row, class_values[:, :, block])
            chi2 = np.einsum("na,ab,nb->n", differences, np.linalg.inv(contrast_covariance), differences)
            p_values.append(chdtrc(block.stop - block.start, chi2))
            ranks.append((p_values[-1][0], -chi2[0] / (block.stop - block.start)))  # by size if p underflows
            contrast_names.append(contrast_name)
        smallest = np.min(p_values, axis=0)
        largest_index = ranks.index(min(ranks))
        p_value = float((1 + np.sum(smallest[1:] <= smallest[0])) / len(smallest))
        return Verdict(p_value, float(smallest[0]), contrast_names[largest_index], len(contrast_names))

    def power(self, kind: str) -> tuple[float, float, float]:
        """Median and 68 % interval of the common systematic error of a component. [µas/yr]

        Parameters
        ----------
        kind : {"T", "S"} or "dipole"
            For the spin or the acceleration, or the dipole of a scalar field.
        """
        kinds = [name for name in self.parameters if name != "mean"]
        shares = self.shares[:, kinds.index(choice("kind", kind, kinds))]
        common_powers = shares.min((1, 2)) if len(self) > 1 else shares[:, 0, 0]
        unit_error = ScalarSpectrum.flat().dipole_error if kind == "dipole" else Spectrum.flat().spin_error
        errors = np.sqrt(np.maximum(common_powers, 0)) * unit_error
        lower, median, upper = np.quantile(errors, [0.16, 0.5, 0.84])
        return float(median), float(lower), float(upper)

    def _sections(self, long):
        facts = [("degrees", f"{format_degrees(self.degrees)}, {self.frame} axes")]
        amplitude_errors = np.sqrt(np.diag(self.amplitude_covariance))
        for name, value, error in zip(self.templates, self.amplitudes, amplitude_errors, strict=True):
            text = f"{format_with_error(value, error, '+')} {self.unit}, {value / error:+.1f} errors"
            facts.append((f"template {name}", text))
        if long:
            odds = ", ".join(f"{name} {100 * p:.0f} %" for name, p in zip(self.shapes, self.probability, strict=True))
            facts.append(("spectra", f"{odds}; effective draws: {', '.join(f'{x:.0f}' for x in self.effective)}"))
        remarks = [self.verdict_words()] if len(self) > 1 else []
        if len(self) > 1:
            change = self.difference(0, len(self) - 1)
            texts = [f"mean {format_with_error(*change.mean, '+')}"] if isinstance(change, ScalarSolution) else []
            names = [name for name, _ in self.parameters.values() if name != "mean"]
            texts += [f"{name} {', '.join(format_components(getattr(change, name)))}" for name in names]
            facts.append(("last − first", "; ".join(texts)))
        if long:
            remarks.append(
                "The systematic errors are assumed to have one of these spectra: higher degrees do not show a part "
                "that affects degree 1 only."
            )
        title = "Classes with systematic errors" if len(self) > 1 else "Systematic errors"
        return (Section(title, facts, self.to_table(), remarks=remarks, notes=self.notes),)

    @cached_property
    def _verdict_and_p_values(self):
        """The verdict, and the p-values of one spin and of one acceleration: report and table have them, each time."""
        return self.verdict(), {name: self.equality(kind) for kind, (name, _) in self.parameters.items()}

    def verdict_words(self, what: str | None = None) -> str:
        """State in one sentence whether the dipole changes from class to class.

        Parameters
        ----------
        what : str, optional
            What classes are made by: "magnitude", say; `made_by` unless given.
        """
        verdict, p_values = self._verdict_and_p_values
        question, noun = ("Does the dipole", "dipole") if "mean" not in p_values else ("Do mean and dipole", "value")
        phrase = "not contradicted" if verdict.p_value > 0.0027 else "contradicted"
        return (
            f"{question} change with {what or self.made_by}? "
            f"{', '.join(f'{name} p = {p:.2g}' for name, p in p_values.items())}; the largest of "
            f"{verdict.looked_at} comparisons ({verdict.comparison}) p = {verdict.p_value:.2g} after allowing for all "
            f"({verdict.face_value:.2g} before that): one {noun} for all is {phrase}."
        )

    def to_table(self) -> Table:
        """A row for each class, and all together, as an astropy Table."""
        rows = [*self.solutions, self.together()]
        columns: dict[str, Any] = {
            "class": [*self.labels, "together"],
            "n_sources": [*self.n_sources, sum(self.n_sources)],
        }
        # Differences of positions have a rotation and a glide.
        attributes = [name for name, _ in self.parameters.values() if name != "mean"]
        titles = {"spin": "rotation", "acceleration": "glide"} if self.unit == "µas" else {}
        if means := [row.mean for row in rows if isinstance(row, ScalarSolution)]:
            columns["mean"], columns["mean_error"] = map(list, zip(*means, strict=True))
        for attribute in attributes:
            name, vectors = titles.get(attribute, attribute), [getattr(row, attribute) for row in rows]
            for k, axis in enumerate("xyz"):
                columns[f"{name}_{axis}"] = [vector.value[k] for vector in vectors]
                columns[f"{name}_{axis}_error"] = [vector.sigma[k] for vector in vectors]
        units = {name: self.unit for name in columns if name not in ("class", "n_sources")}
        meta: dict[str, Any] = {f"probability {name}": p for name, p in zip(self.shapes, self.probability, strict=True)}
        if len(self) > 1:
            verdict, p_values = self._verdict_and_p_values
            meta |= {f"p_value_{name}": p for name, p in p_values.items()} | {"p_value_largest": verdict.p_value}
            meta["summary"] = self.verdict_words().rstrip(".")
        return tables.table_of(columns, meta | {"frame": self.frame}, units)

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Spin and acceleration of the classes with their errors on matplotlib axes."""
        from fit.background._plot import plot_classes

        return plot_classes(self, ax=ax)

    def _fold_covariance(self):
        return self.covariance.reshape(2 * self.values.shape)

    def _select_kind_slice(self, kind):
        """The place of a kind of parameters, "T" say, among those of a class, as a slice."""
        return self.parameters[choice("kind", kind, tuple(self.parameters))][1]

    def combination(self, weights: ArrayLike) -> Solution:
        """Degree 1 of a sum of the classes.

        Parameters
        ----------
        weights : (K,) array
            One a class.
        """
        weight_row = np.asarray(weights, float)
        n_sources = sum(n for n, weight in zip(self.n_sources, weight_row, strict=True) if weight)
        values = weight_row @ self.values
        covariance = np.einsum("i,iajb,j->ab", weight_row, self._fold_covariance(), weight_row)
        return self._make_degree_one_solution(values, covariance, n_sources)

    def _make_degree_one_solution(self, values, covariance, n_sources):
        solution_class: Any = Solution if len(values) == 6 else ScalarSolution
        return solution_class(
            coefficients=solution_class._coefficients(1, values),
            covariance=covariance,
            chi2=float("nan"),
            n_data=len(values) // 3 * n_sources,
            frame=self.frame,
            unit=self.unit,
            errors_from=f"normal equations, with systematic errors, degrees {format_degrees(self.degrees)}",
            error_source=ErrorSource.JOINT,
            includes_floor=True,
        )

    def _compute_change_p_value(self, kind, positions):
        if len(self) < 2:
            raise ParameterError("a comparison needs two classes at least, not one")
        block = slice(None) if kind is None else self._select_kind_slice(kind)
        design, p_sum = np.ones((len(self), 1)), 0.0
        for mean, covariance in zip(self.means[:, :, block], self.covariances[:, :, block][..., block], strict=True):
            matrix, n_parameters = covariance.reshape(mean.size, mean.size), mean.shape[1]
            misfit, dof = gls(mean, matrix, design)[1], mean.size - n_parameters
            if positions is not None:
                misfit, dof = misfit - gls(mean, matrix, np.c_[design, positions - positions.mean()])[1], n_parameters
            p_sum += chdtrc(dof, max(misfit, 0.0))
        return float(p_sum / len(self.means))

    def _make_contrasts(self):
        """Edges between neighbours, low against high by their information, and a slope, for spin and acceleration."""
        k = len(self)
        if k < 2:
            raise ParameterError("a comparison needs two classes at least, not one")
        weight = 1 / np.diag(self.covariance).reshape(k, -1).mean(1)
        positions = np.arange(k) - weight @ np.arange(k) / weight.sum()
        rows = []
        for edge in range(1, k):
            sum_below, sum_above = weight[:edge].sum(), weight[edge:].sum()
            name = f"{self.labels[edge]} {'and above against below' if k > 2 else f'against {self.labels[0]}'}"
            rows.append((np.where(np.arange(k) < edge, -weight / sum_below, weight / sum_above), name))
        if k > 2:
            rows.append((weight * positions, "a slope"))
        return [(row, kind, f"{name}, {label}") for row, name in rows for kind, (label, _) in self.parameters.items()]


def pool_draw_covariances(means: FloatArray, covariances: FloatArray) -> FloatArray:
    """Covariance over draws of equal weight, (K, f, K, f): the mean of theirs, and the scatter of their means."""
    deviations = means - means.mean(0)
    return covariances.mean(0) + np.einsum("nia,njb->iajb", deviations, deviations) / len(deviations)


def compute_contrast_p_value(means: FloatArray, covariances: FloatArray, contrasts: FloatArray) -> float:
    """p-value of combinations of classes, (r, K), that are all zero: the mean over draws of (K, f) parameters."""
    values = np.einsum("ri,nia->nra", contrasts, means).reshape(len(means), -1)
    covariance = np.einsum("ri,niajb,sj->nrasb", contrasts, covariances, contrasts).reshape(*values.shape, -1)
    solved_values = np.linalg.solve(covariance, values[..., None])[..., 0]
    return float(np.mean(chdtrc(values.shape[1], np.sum(values * solved_values, 1))))


@log_calls("shared errors")
def shared(
    normals: Sequence[NormalEquations | Solution],
    degrees: Iterable[int] | None = None,
    *,
    labels: Sequence[str] | None = None,
    shapes: Sequence[str | Spectrum] | None = None,
    own: str = "each",
    draws: int = 400,
    noise_scale: bool | None = None,
    rng: Rng = 1,
) -> ClassComparison:
    """Spin and acceleration of classes of sources, with common systematic errors: bins, magnitudes, halves of the sky.

    Parameters
    ----------
    normals : sequence of NormalEquations
        Normal equations of each class, all to degree 3 or higher and in the same frame. No source may belong to two
        classes.
    degrees : iterable of int, optional
        Consecutive degrees starting with 2; default: up to the highest degree that all classes have. 5 to 7 are best
        for one or two classes, 5 for three to five. If a class covers only part of the sky, give normal equations with
        three more degrees than `degrees`. The additional degrees are marginalised, with a prior power from a first
        estimate; otherwise they would leak into the lower ones.
    labels : sequence of str, optional
        Names of the classes.
    shapes : sequence of "flat", "gaia", "steep" or Spectrum, optional
        Spectra, averaged by their evidence and prior odds, as in `floor`.
    own : {"each", "one"}
        Whether each class has a power of its own in addition to the common one ("each"), or one power for the
        class-specific errors of all classes ("one"). "one" gives smaller errors, but wrong ones if one class has
        larger systematic errors than the others.
    draws : int
        Number of random draws of the amplitudes for each spectrum; it is increased if the effective number of draws is
        small.
    noise_scale : bool, optional
        Whether each class's errors are scaled by its own χ²/dof. Default: yes, except for solutions whose errors
        already come from residuals or replicates.
    rng : Generator or int
        The source of all randomness.

    Raises
    ------
    ModesError
        If degrees are not 2, 3, …, or not fitted: degrees 1 and 2 alone contain no information on systematic errors.
    FrameError
        If classes stand in different frames.
    DegeneracyError
        If a class is empty, or does not determine its degree 1.

    Notes
    -----
    The method fails if systematic errors are present only in degree 1, or if their spectrum rises towards degree 1
    more steeply than the assumed spectra. Coverage on simulated skies: docs/backgrounds.md.

    Examples
    --------
    >>> from fit import normal_equations
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
    >>> field = Field(lon, lat, rng.normal(size=(2, 2000)), np.ones((2, 2000)))
    >>> classes = shared([normal_equations(field[:1000], 4), normal_equations(field[1000:], 4)], draws=100)
    >>> bool(classes.equality() > 0.01)
    True
    """
    random = generator(rng)
    shape_draws, modes, notes, facts = sample_class_errors(
        normals, degrees, labels=labels, shapes=shapes, own=own, draws=draws, noise_scale=noise_scale, rng=random
    )
    return average_draws(shape_draws, modes, random, notes=notes, **facts)


def sample_class_errors(
    normals: Any,
    degrees: Iterable[int] | None,
    *,
    labels: Sequence[str] | None,
    shapes: Sequence[str | Spectrum] | None,
    own: str,
    draws: int,
    noise_scale: bool | None,
    rng: np.random.Generator,
    free: Callable[[Modes], BoolArray] | None = None,
) -> tuple[list[ShapeDraws], Modes, list[str], dict[str, Any]]:
    """Draws of the systematic errors of classes, as `shared` takes them; the modes, notes, and facts of the classes.

    `free` tells the modes that each class has for itself; degree 1 unless given.
    """
    choice("own", own, ("each", "one"))
    sources = [normals] if isinstance(normals, NormalEquations | Solution) else list(normals)
    if not sources:
        raise ParameterError("there are no classes: give normal equations, one a class")
    equations = [equations_of(source, scalars=True) for source in sources]
    if len({type(normal.modes) for normal in equations}) > 1:
        raise ModesError("classes are motions and numbers: compare those of one kind")
    frames = {normal.frame for normal in equations}
    if len(frames) > 1:
        raise FrameError(f"classes are in {' and '.join(sorted(map(str, frames)))}: take all to one frame")
    units = {normal.unit for normal in equations} - {None}
    if len(units) > 1:
        raise ParameterError(f"classes are in {' and '.join(sorted(map(str, units)))}: take all to one unit")
    templates = [tuple(template.name for template in normal.templates) for normal in equations]
    if any(template_names != templates[0] for template_names in templates):
        raise ParameterError("classes have different templates: give all of them the same maps")
    scale_flags = [should_fit_scale(source, noise_scale) for source in sources]
    class_labels = tuple(f"class {k + 1}" for k in range(len(sources))) if labels is None else tuple(map(str, labels))
    if len(class_labels) != len(sources):
        raise ParameterError(f"{len(class_labels)} labels for {len(sources)} classes")
    modes = type(equations[0].modes)(_choose_highest_degree(equations, degrees))
    spectra = make_named_spectra(list_shapes(modes.lmax) if shapes is None else shapes, modes)
    draws, is_free = whole("draws", draws), None if free is None else free(modes)

    def sample_draws(classes):
        return sample_amplitudes_by_shape(classes, modes, spectra, own, draws, rng)

    classes, notes = _reduce_classes(equations, class_labels, modes, scale_flags, is_free)
    notes += _describe_leakage(equations, classes, class_labels, modes) if len(classes) > 1 else []
    shape_draws = sample_draws(classes)
    if any(normal.modes.lmax > modes.lmax for normal in equations):
        equations = _marginalise_leakage(equations, shape_draws, modes)
        # What was noted of them above stays.
        shape_draws = sample_draws(_reduce_classes(equations, class_labels, modes, scale_flags, is_free)[0])
    facts = {
        "labels": class_labels, "n_sources": tuple(normal.n_sources for normal in equations),
        "frame": equations[0].frame or "icrs", "unit": equations[0].unit or "",
        "templates": templates[0],
    }  # fmt: skip
    return shape_draws, modes, notes + _describe_few_draws(shape_draws), facts


def _describe_few_draws(draws):
    if min(lot.effective for lot in draws if lot.probability > 0.05) >= MIN_EFFECTIVE_DRAWS:
        return []
    return ["few draws of the systematic errors count: give more of them (draws=), or merge classes"]


def _marginalise_leakage(equations, shape_draws, modes):
    """Equations of `modes` alone: higher degrees have the power that a first estimate, `shape_draws`, gives them."""
    all_modes = max((normal.modes for normal in equations), key=len)
    powers = compute_class_variances(shape_draws, all_modes)
    return [
        marginalise_higher_degrees(normal, modes, power[all_modes.degrees <= normal.modes.lmax], scale)
        if normal.modes.lmax > modes.lmax
        else normal
        for normal, scale, power in zip(equations, shape_draws[0].likelihood.classes.noise_scale, powers, strict=True)
    ]


def _describe_leakage(equations, classes, labels, modes):
    """A note on classes into which higher degrees leak, and what to do."""
    leaky_labels = [
        label
        for normal, condition, label in zip(equations, classes.condition, labels, strict=True)
        if PART_SKY_CONDITION < condition <= _MAX_CONDITION and normal.modes.lmax < modes.lmax + EXTRA_DEGREES
    ]
    if not leaky_labels:
        return []
    return [
        f"{', '.join(leaky_labels)}: a part of the sky, or few sources, into whose degrees higher ones leak; give "
        f"normal equations to degree {modes.lmax + EXTRA_DEGREES} and degrees=range(2, {modes.lmax + 1}), and that is "
        "allowed for"
    ]


def average_draws(
    draws: Sequence[ShapeDraws], modes: Modes, rng: np.random.Generator, *, notes: Sequence[str] = (), **facts: Any
) -> ClassComparison:
    """Shared errors of the classes, averaged over draws of their amplitudes and over spectra."""
    classes = draws[0].likelihood.classes
    with limit_blas(len(classes) * len(modes)):
        means, covariances, shares, (amplitudes, amplitude_covariance) = resample_draws(draws, rng)
    return ClassComparison(
        means=means, covariances=covariances, shares=shares, shapes=tuple(lot.shape for lot in draws),
        probability=tuple(lot.probability for lot in draws), effective=tuple(lot.effective for lot in draws),
        degrees=tuple(range(2, modes.lmax + 1)), noise_scale=classes.noise_scale,
        notes=tuple(notes), amplitudes=amplitudes, amplitude_covariance=amplitude_covariance, **facts,
    )  # fmt: skip


def _choose_highest_degree(equations, degrees):
    lowest_lmax = min(normal.modes.lmax for normal in equations)
    if degrees is None:
        highest = lowest_lmax
    else:
        unique_degrees = sorted({whole("degrees", l) for l in ([degrees] if isinstance(degrees, int) else degrees)})
        if not unique_degrees or unique_degrees != list(range(2, unique_degrees[-1] + 1)):
            raise ModesError(f"systematic errors are estimated in degrees 2, 3, … without a gap, not {unique_degrees}")
        highest = unique_degrees[-1]
    if highest < 3:
        raise ModesError("degrees 1 and 2 tell nothing of systematic errors: fit degree 3 or more, 5 for classes")
    if highest > lowest_lmax:
        raise ModesError(f"degree {highest} is not fitted in every class: the least goes to {lowest_lmax}")
    return highest


def make_named_spectra(shapes: Any, modes: Modes) -> list[tuple[str, Any]]:
    """Names and spectra of shapes for some modes; ParameterError where one is none."""
    named, kind = (SCALAR_SHAPES, ScalarSpectrum) if modes.components == 1 else (SHAPES, Spectrum)
    shape_list = [shapes] if isinstance(shapes, str | SpectrumOfKind) else list(shapes)
    for shape in shape_list:
        if type(shape) is not kind and (isinstance(shape, SpectrumOfKind) or shape not in named):
            raise ParameterError(f"a shape is {', '.join(map(repr, named))} or a {kind.__name__}, not {shape!r}")
    if not shape_list:
        raise ParameterError("a shape of the spectrum is needed: 'flat', 'gaia' or a Spectrum")
    return [(shape.name, shape) if isinstance(shape, SpectrumOfKind) else (shape, named[shape]) for shape in shape_list]


def _reduce_classes(equations, labels, modes, scale_flags, is_free=None) -> tuple[ClassEquations, list[str]]:
    classes, notes = [], []
    for normal, label, is_scaled in zip(equations, labels, scale_flags, strict=True):
        if not normal.n_data:
            raise DegeneracyError(f"the class {label} is empty: leave it out")
        try:
            classes.append(reduce_class_equations(normal, modes, is_scaled, is_free))
        except DegeneracyError as error:
            raise DegeneracyError(f"{label}: {error}") from None
        if classes[-1].condition[0] > _MAX_CONDITION:
            notes.append(
                f"warning: the class {label} sees too little of the sky to tell degrees to {modes.lmax} apart, and its "
                "errors rest on the assumed spectra: a larger class, or lower degrees, would say more by themselves"
            )
    return ClassEquations.from_separate_classes(classes), notes


def compare_classes_jointly(
    matrix: FloatArray, rhs: FloatArray, modes: Modes, *, draws: int = 400, rng: Rng = 1, **facts: Any
) -> ClassComparison:
    """Compute `shared` from the normal equations of all classes together, (K, p, K, p) and (K, p)."""
    classes = ClassEquations.from_joint_equations(matrix, rhs, modes)
    random, spectra = generator(rng), make_named_spectra(list_shapes(modes.lmax), modes)
    shape_draws = sample_amplitudes_by_shape(classes, modes, spectra, "each", draws, random)
    return average_draws(shape_draws, modes, random, notes=_describe_few_draws(shape_draws), **facts)


def extend_degrees(
    normals: Sequence[NormalEquations], make_equations: Callable[[Any, int], NormalEquations], classes: Iterable[Any]
) -> list[NormalEquations]:
    """Equations of classes; by `make_equations` to three degrees more of all where one sees a part of the sky."""
    lmax = normals[0].modes.lmax
    if not any(has_leakage(normal, lmax) for normal in normals):
        return list(normals)
    return [make_equations(sources, lmax + EXTRA_DEGREES) for sources in classes]


def has_leakage(normal: NormalEquations, lmax: int) -> bool:
    """Return whether sources are so few, or see so small a part of the sky, that higher degrees leak into those to
    `lmax`."""
    low_indices = np.flatnonzero(normal.modes.degrees <= lmax)
    try:
        return compute_condition_number(normal.matrix[np.ix_(low_indices, low_indices)]) > PART_SKY_CONDITION
    except DegeneracyError:  # an empty class: that is said elsewhere
        return False


def compute_class_variances(draws: Sequence[ShapeDraws], modes: Modes) -> FloatArray:
    """Variances of the coefficients of each class, (K, p), the mean over draws and shapes."""
    total: FloatArray = np.zeros(())
    for lot in draws:
        shares = [lot.likelihood.compute_shares(x)[:2].diagonal(axis1=1, axis2=2) for x in lot.x]  # (2, K)
        mean_shares = np.tensordot(lot.weight, shares, 1)
        total = total + lot.probability * mean_shares[map_parities(modes)].T * lot.scale * lot.spectrum.variances(modes)
    return total


def marginalise_higher_degrees(
    normal: NormalEquations, modes: Modes, variances: FloatArray, noise_scale: float
) -> NormalEquations:
    """The equations of `modes`, all higher degrees marginalised with a prior of so much power, (p,)."""
    is_low = normal.modes.degrees <= modes.lmax
    matrix, rhs, gain = eliminate(normal.matrix, normal.rhs, is_low, ~is_low, variances[~is_low] / noise_scale**2)
    chi2_null = float(normal.chi2_null - gain)
    templates = tuple(_truncate_and_normalise_template(template, is_low, modes) for template in normal.templates)
    return replace(normal, modes=modes, matrix=matrix, rhs=rhs, chi2_null=chi2_null, templates=templates)


def _truncate_and_normalise_template(template, is_low, modes):
    """A template of these modes alone, of 1 µas/yr rms over the sky."""
    values = template.values[is_low]
    return template._replace(values=values / np.sqrt(values**2 @ modes.norm2 / (4 * np.pi)))
