"""A link of frames: orientation and spin at any magnitude, what each source does to it, and what to observe next."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import logsumexp

from fit.frames.link._likelihood import NORMAL, Node, Tails, combine_nodes, estimate_influence
from fit.frames.link._rows import VECTORS, Unknowns, WhitenedDifferences, make_equations
from fit.frames.results import FrameResult
from fit.results.quality import SEEN, f_p_value, hint_of
from fit.results.solution import NamedSolution
from fit.results.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.models.bright_stars import BRIGHT, published_spin
from vsh.sky.astrometry import AstrometryRows
from vsh.sky.frames import rotation_matrix
from vsh.tools import arguments
from vsh.tools.digits import format_p_value, format_values, format_with_error
from vsh.tools.errors import FieldError, ParameterError
from vsh.tools.notes import doubts_of
from vsh.tools.printing import one_line_text
from vsh.tools.types import Axes, AxesArray, FloatArray, IntArray, OnAxes, Table
from vsh.vector import Vector

#: Sources that the report lists, of the most doubtful and of the most influential.
_MOST_LISTED = 8
#: A source that moves a parameter by more than so many errors is said to.
_HEAVY = 2.0


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameTie(FrameResult, NamedSolution):
    """Orientation and spin of catalogues against a reference.

    Attributes
    ----------
    names, values, covariance, chi2, n_data, frame, notes
        As a `NamedSolution`'s: `epsilon_x` … [µas] and `omega_x` … [µas/yr], with a jump or a power in brackets and
        the catalogue before a colon where there are several. χ² is that of formal errors.
    unknowns : Unknowns
    reference : str
    sources : tuple of str
        The sources that tell anything of the frame.
    magnitude : (n,) array
        Their magnitudes.
    rows : (n,) int array
        How many rows of the catalogues each has.
    distances : (n,) array
        √χ² of each per difference, with formal errors.
    outlier : (n,) array
        Probability that its errors are more than three times those of the others.
    influence : (n, p) array
        By how many errors each parameter would change without it.
    tails : Tails
        What the errors are like where the posterior is highest: degrees of freedom ν of Student's t (1e6 is a normal
        distribution), the share of outliers and how many times larger their errors are.
    scale : float
        By which errors were multiplied there, with outliers counted apart.
    excess : float
        Offset between the reference's and other positions. [µas]
    information : (p, p) array
        What one source tells of the parameters, in the mean.
    log_evidence : float
        ln of the evidence, flat in the parameters: of links with as many of them by the same data.
    searched : tuple of float
        Where the place of the step was searched for: p-values of no jump after allowing for all places, of all vectors
        together and then of each. Empty where the step was given.
    fixed : dict
        Catalogues that are fixed to calibrators, and the epoch of these, as of `link`.
    """

    unknowns: Any = None
    reference: str = ""
    sources: tuple[str, ...] = ()
    magnitude: FloatArray = None  # type: ignore[assignment]
    rows: IntArray = None  # type: ignore[assignment]
    distances: FloatArray = None  # type: ignore[assignment]
    outlier: FloatArray = None  # type: ignore[assignment]
    influence: FloatArray = None  # type: ignore[assignment]
    tails: Tails = NORMAL
    scale: float = 1.0
    excess: float = 0.0
    information: FloatArray = None  # type: ignore[assignment]
    log_evidence: float = float("nan")
    searched: tuple[float, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<FrameTie: {', '.join(self.unknowns.turned)} against {self.reference}, {len(self.sources)} sources>"

    def vector(self, name: str, magnitude: float | None = None, catalogue: str | None = None) -> Vector:
        """Orientation, spin or acceleration, at a magnitude.

        Parameters
        ----------
        name : str
            "orientation", "spin" or "acceleration".
        magnitude : float, optional
            The constant terms alone unless given.
        catalogue : str, optional
            Whose; the one that is turned, or the first of several, unless given.

        Raises
        ------
        ParameterError
            If the vector was not sought, or the catalogue is not turned.
        """
        catalogue_name = catalogue or (self.unknowns.turned[0] if self.unknowns.turned else "")
        if name not in self.unknowns.vectors or (name != "acceleration" and catalogue_name not in self.unknowns.turned):
            raise ParameterError(f"{name} of {catalogue_name} was not sought: {', '.join(self.unknowns.vectors)} were")
        combination = self.unknowns.combination(name, catalogue_name, magnitude)
        covariance = combination @ self.covariance @ combination.T
        covariance = (covariance + covariance.T) / 2  # of large variances that a prior cancels, rounding is left
        return Vector(combination @ self.values, covariance, self.frame, VECTORS[name][1])

    def jump(self, step: float, vector: str = "spin", catalogue: str | None = None) -> tuple[Vector, float]:
        """The jump at a magnitude, and the probability of as large a one by chance.

        Parameters
        ----------
        step : float
            One of the steps that were sought.
        vector : str
            "orientation" or "spin".
        catalogue : str, optional
            As for `vector`.

        Raises
        ------
        ParameterError
            If no such step was sought.
        """
        if step not in self.unknowns.steps:
            raise ParameterError(
                f"no step was fitted at {step:g}; fitted are {', '.join(map(str, self.unknowns.steps)) or 'none'}"
            )
        combination = self.unknowns.jump(vector, catalogue or self.unknowns.turned[0], step)
        value, covariance, p_value = self._combine_and_test(combination)
        return Vector(value, covariance, self.frame, VECTORS[vector][1]), p_value

    def jump_covariance(self, step: float) -> FloatArray:
        """Covariance of the jumps of all vectors and catalogues at a step, (k, k).

        Parameters
        ----------
        step : float
            One of the steps that were sought.
        """
        return self._combine_and_test(self._make_jump_matrix(step))[1]

    def _make_jump_matrix(self, step, vectors=None):
        """Rows from the parameters to the jumps of some vectors, all unless given, of all catalogues."""
        unknowns, vectors = self.unknowns, vectors or self._jumping_vectors
        return np.concatenate(
            [unknowns.jump(vector, catalogue, step) for catalogue in unknowns.turned for vector in vectors]
        )

    @property
    def _jumping_vectors(self):
        """The vectors that jump at a step."""
        return [vector for vector in self.unknowns.vectors if vector != "acceleration"]

    def _combine_and_test(self, combination):
        """Compute a combination of the parameters, its covariance, and the probability of as much by chance."""
        value, covariance = combination @ self.values, combination @ self.covariance @ combination.T
        chi2 = value @ np.linalg.solve(covariance, value)
        return value, covariance, f_p_value(float(chi2), len(combination), self.dof)

    def model(self, field: Field) -> FloatArray:
        """The motions by which the first catalogue turns at the sources of a field, (2, n). [µas/yr]

        Parameters
        ----------
        field : Field
            The sources, with magnitudes where the frame depends on them.

        Raises
        ------
        FieldError
            If it depends on what the sources do not have.
        """
        magnitude = np.full(len(field), np.nan) if field.magnitude is None else field.magnitude
        functions = self.unknowns.functions(magnitude)
        if np.isnan(functions).any():
            raise FieldError("the frame depends on magnitude, which the sources do not have")
        epoch = np.full(len(field), self.unknowns.epoch)
        design = self.unknowns.design(field.lon, field.lat, epoch, functions, self.unknowns.turned[0])
        return (design[:, 3:] @ self.values).T

    def at_epoch(self, epoch: float, magnitude: float | None = None, catalogue: str | None = None) -> Vector:
        """The orientation at an epoch.

        Parameters
        ----------
        epoch : float
            [Julian year]
        magnitude, catalogue
            As for `vector`.

        Raises
        ------
        ParameterError
            If no orientation was fitted.
        """
        catalogue_name = catalogue or self.unknowns.turned[0]
        if "orientation" not in self.unknowns.vectors:
            raise ParameterError("no orientation was fitted, so there is none at any epoch")
        a = self.unknowns.combination("orientation", catalogue_name, magnitude)
        if "spin" in self.unknowns.vectors:
            a = a + (epoch - self.unknowns.epoch) * self.unknowns.combination("spin", catalogue_name, magnitude)
        return Vector(a @ self.values, a @ self.covariance @ a.T, self.frame, "µas")

    def with_more(self, count: int) -> FloatArray:
        """Errors that the parameters would have with so many more sources like these, (p,).

        Parameters
        ----------
        count : int
            How many more.
        """
        return np.sqrt(np.diag(np.linalg.inv(np.linalg.inv(self.covariance) + count * self.information)))

    def _sections(self, long):
        unknowns, n_sources = self.unknowns, len(self.sources)
        catalogues = ", ".join(unknowns.turned) or self.reference
        model = f"Δα* = q·ε, Δδ = −p·ε with ε + ω (t − {unknowns.epoch:g})"
        differences = f"{n_sources}, with {self.n_data} differences after their own positions, parallaxes and motions"
        facts = [
            ("sources", f"{differences} are eliminated"),
            ("model", f"{model}, catalogue − reference ({self.frame} axes); ICRF3's R1, R2, R3 are −ε"),
            ("χ²/dof", f"{self.chi2:.5g} / {self.dof} = {self.reduced_chi2:.3g} with formal errors"),
        ]
        if self.excess:
            facts.append(("offset", f"{self.excess:.3g} µas a coordinate, of positions of {self.reference}"))
        if "spin" in unknowns.vectors and re.search("gaia|dr3", catalogues, re.IGNORECASE):
            facts += self._quote_published_spin()
        facts += self._list_level_and_jump_facts(long)
        if long:
            error_ratio = np.mean(self.with_more(10) / self.sigma)
            facts.append(("10 more sources", f"like these would give {error_ratio:.2f} of these errors"))
        table = None if unknowns.steps and not long else self.to_table()  # else the levels say it in fewer lines
        remarks = self._write_source_remarks()
        title, columns = f"{catalogues} against {self.reference}", ("parameter", "value", "sigma", "unit")
        section = Section(title, facts, table, columns, remarks=remarks, notes=self.notes)
        return (section, *(self._make_source_sections() if long else ()))

    def _quote_published_spin(self):
        """Quote the spin that was published of the bright ones among these sources; nothing where none is bright."""
        if not len(bright := self.magnitude[self.magnitude < BRIGHT]):
            return []
        median = float(np.median(bright))
        spin = ", ".join(f"{value:+.1f}" for value in rotation_matrix("icrs", self.frame) @ published_spin(median))
        words = f"median of {len(bright)} sources with G < {BRIGHT:g}, by clusters and binaries"
        text = f"spin ({spin}) µas/yr of (E)DR3 at G = {median:.1f}, {words} (Cantat-Gaudin & Brandt 2021)"
        return [("published", text)]

    def _write_source_remarks(self):
        """Write sentences on probable outliers, and on sources that the answer hangs on."""
        count = int(np.sum(self.outlier > 0.5))
        outliers = np.argsort(-self.outlier, kind="stable")[:count]
        remarks = []
        if count:
            names = ", ".join(one_line_text(self.sources[i]) for i in outliers[:_MOST_LISTED])
            names += f" and {count - _MOST_LISTED} more" if count > _MOST_LISTED else ""
            remarks.append(
                f"Probable outliers (errors more than three times as large): {count} of {len(self.sources)}: {names}."
            )
        largest = np.abs(self.influence).max(1)
        heavy = [one_line_text(self.sources[i]) for i in np.argsort(-largest, kind="stable") if largest[i] > _HEAVY]
        if heavy:
            remarks.append(
                f"warning: {', '.join(heavy[:3])} alone move{'s' * (len(heavy) == 1)} a parameter by more than "
                f"{_HEAVY:g} of its errors: with errors that are too small the whole answer is theirs"
            )
        return remarks

    def _make_source_sections(self):
        """Make sections of the sources that are most probably outliers, and of those with most influence."""
        outliers = np.argsort(-self.outlier, kind="stable")[: max(int(np.sum(self.outlier > 0.5)), 3)][:_MOST_LISTED]
        outlier_columns = {
            "source": [one_line_text(self.sources[i]) for i in outliers],
            "probability": self.outlier[outliers],
            "formal errors": self.distances[outliers],
        }
        most_influential = np.argsort(-np.abs(self.influence).max(1), kind="stable")[:3]
        most_moved = np.abs(self.influence[most_influential]).argmax(1)
        influence_columns = {
            "source": [one_line_text(self.sources[i]) for i in most_influential],
            "parameter": [self.names[k] for k in most_moved],
            "errors": self.influence[most_influential, most_moved],
        }
        doubtful, influential = tables.table_of(outlier_columns), tables.table_of(influence_columns)
        forms = {"probability": ".2f", "formal errors": ".1f"}
        return (
            Section("Sources most probably outliers", (), doubtful, forms=forms),
            Section("Sources with most influence, were they left out", (), influential, forms={"errors": "+.2f"}),
        )

    @property
    def answer(self) -> Answer:
        """The result to quote: whether frames are turned, and whether they jump, a line each."""
        steps, powers = self.unknowns.steps, self.unknowns.order
        at = f", brighter than {min(steps):.4g} mag" if steps else ", at G = 13" if powers else ""
        several = len(self.unknowns.turned) > 1
        lines = doubts_of(self.notes) + [
            (f"{name}, {catalogue}" if several else name, f"{self._format_vector(name, catalogue)} ({catalogue}{at})")
            for catalogue in self.unknowns.turned
            for name in ("orientation", "spin")
            if name in self.unknowns.vectors
        ]
        for catalogue in self.unknowns.turned if self.unknowns.has_parallax_terms else ():
            i_zero, i_scale = (self.names.index(name) for name in self.unknowns.parallax_names(catalogue))
            values, sigma = self.values.tolist(), self.sigma.tolist()
            parallax_words = (
                f"zero point {format_with_error(values[i_zero], sigma[i_zero], '+')} µas, scale "
                f"{format_with_error(1 + values[i_scale], sigma[i_scale])} ({catalogue} relative to {self.reference})"
            )
            lines.append((f"parallaxes, {catalogue}" if several else "parallaxes", parallax_words))
        for step in steps:
            p_value, *p_values = self.jump_p_values(step)
            texts = [
                f"{vector} {self._format_jump(step, vector) if p < SEEN else 'not detected'} (p = {format_p_value(p)})"
                for vector, p in zip(self._jumping_vectors, p_values, strict=True)
            ]
            # One of two vectors can be detected where both together are not: a hint would contradict it.
            hint = "" if min(p_values) < SEEN else hint_of(p_value)
            if len(p_values) > 1:
                texts.append(f"both together p = {format_p_value(p_value)}{hint and f' ({hint})'}")
            remark = "; p-values allow for all places" if self.searched else ""
            lines.append((f"jump at {step:.4g}", ", ".join(texts) + remark))
        errors = f"{self._format_tails()}, times {self.scale:.3g}: from the residuals of {len(self.sources)} sources"
        return Answer((*lines, ("errors", errors)))

    def _format_jump(self, step, vector):
        """Format the jump of a vector at a step, by its components where there is one catalogue."""
        if len(self.unknowns.turned) > 1:
            return "detected"
        jump = self.jump(step, vector)[0]
        return f"detected: ({', '.join(format_values(jump.value, jump.sigma))}) {jump.unit}"

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of each catalogue that is turned with the reference."""
        return tuple((name, self.reference) for name in self.unknowns.turned)

    def vectors(self, one: str | None = None, two: str | None = None) -> dict[str, Vector]:
        """Orientation and spin of a catalogue at the constant terms, by name; the acceleration where it was fitted.

        Parameters
        ----------
        one, two : str, optional
            The catalogue that is turned, the first unless given; and the reference.

        Raises
        ------
        ParameterError
            If the second is not the reference.
        """
        if two not in (None, self.reference):
            raise ParameterError(f"catalogues are turned against {self.reference}, not against {two}")
        return {name: self.vector(name, catalogue=one) for name in self.unknowns.vectors}

    def jump_p_values(self, step: float) -> tuple[float, ...]:
        """Probability of as large a jump by chance: of all vectors and catalogues together, then of each vector.

        Parameters
        ----------
        step : float
            One of the steps that were sought; where its place was searched for, after allowing for all places.
        """
        if self.searched:
            return self.searched
        vector_groups = [None, *([vector] for vector in self._jumping_vectors)]
        return tuple(self._combine_and_test(self._make_jump_matrix(step, vectors))[2] for vectors in vector_groups)

    def _list_level_and_jump_facts(self, long):
        """List the value of each vector between the steps, and the p-values of the jumps."""
        facts, unknowns = [], self.unknowns
        for catalogue in unknowns.turned if unknowns.steps else ():
            for vector in self._jumping_vectors:
                for label, magnitude in unknowns.levels:
                    level = self.vector(vector, magnitude, catalogue=catalogue)
                    components = ", ".join(format_values(level.value, level.sigma))
                    facts.append((f"{vector} of {catalogue}, {label}", f"{components} {level.unit}"))
        for step in unknowns.steps if long else ():
            p_value, *p_values = self.jump_p_values(step)
            texts = [f"{vector} {format_p_value(p)}" for vector, p in zip(self._jumping_vectors, p_values, strict=True)]
            remark = "after allowing for all places" if self.searched else "as if the place were known in advance"
            texts += [f"together {format_p_value(p_value)}"] * (len(p_values) > 1)
            facts.append((f"p-values of no jump at {step:.4g} mag, {remark}", ", ".join(texts)))
        return facts

    def _format_vector(self, name, catalogue):
        vector = self.vector(name, catalogue=catalogue)
        p_value = self._combine_and_test(self.unknowns.combination(name, catalogue))[2]
        if p_value < SEEN:
            amplitude = format_with_error(vector.amplitude, vector.amplitude_error)
            return f"{amplitude} {vector.unit}, p = {format_p_value(p_value)}"
        return f"not detected: < {vector.amplitude_limit():.3g} {vector.unit} (95 %), p = {format_p_value(p_value)}"

    def to_table(self) -> Table:
        """Parameters with their errors, units and correlations as an astropy Table, a row each; tests in its meta."""
        table = super().to_table()
        units = [unit.replace("µ", "u").replace("/", " / ") for unit in self.unknowns.units]
        table.add_column(units, 3, "unit")
        table.meta |= {"reference": self.reference, "epoch": self.unknowns.epoch, "n_sources": len(self.sources)}
        table.meta |= {"chi2": self.chi2, "dof": self.dof, "summary": self.verdict}
        endings = ["", *(f"_{vector}" for vector in self._jumping_vectors)]
        for step in self.unknowns.steps:
            for ending, p_value in zip(endings, self.jump_p_values(step), strict=True):
                table.meta[f"p_value_jump_{step:g}{ending}"] = p_value
        return table

    def _format_tails(self):
        nu, share = self.tails.nu, self.tails.share
        law = "normal" if nu > 1e5 else f"Student's t, ν = {nu:g}"
        return law + (f", {100 * share:.0f} % outliers with errors {self.tails.times:g} times larger" if share else "")

    def sources_table(self) -> Table:
        """A row for each source: magnitude, rows, distance, probability of an outlier, influence; an astropy Table."""
        columns: dict[str, Any] = {
            "source": np.array(self.sources, dtype=str), "magnitude": self.magnitude, "rows": self.rows,
            "distance": self.distances, "outlier": self.outlier, "influence": np.abs(self.influence).max(1),
        }  # fmt: skip
        columns["on"] = np.array(self.names, dtype=str)[np.abs(self.influence).argmax(1)]
        return tables.table_of(columns, {"frame": self.frame, "reference": self.reference})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Orientation and spin against magnitude, and influence and distance of the sources."""
        from fit.frames.link._plot import plot_link

        return plot_link(self, ax=ax)


def make_frame_tie(
    nodes: Sequence[Node],
    rows: WhitenedDifferences,
    prior: tuple[FloatArray, FloatArray],
    unknowns: Unknowns,
    reference: str,
    notes: tuple[str, ...],
) -> FrameTie:
    """The solution of nodes of the likelihood, with what each source has to do with it."""
    values, covariance, probabilities = combine_nodes(nodes)
    best_node = nodes[int(np.argmax(probabilities))]
    outlier = np.sum([w * node.outlier for w, node in zip(probabilities, nodes, strict=True)], axis=0)
    sizes = rows.dims
    residuals = rows.rhs - rows.design @ values
    chi2 = np.bincount(rows.source, residuals**2, minlength=len(sizes))
    influence = estimate_influence(nodes, probabilities, rows, prior, values) / np.sqrt(np.diag(covariance))
    information = (np.linalg.inv(covariance) - prior[0]) / len(sizes)
    return FrameTie(
        names=unknowns.names, values=values, covariance=covariance, chi2=float(chi2.sum()), n_data=len(rows.rhs),
        frame="icrs", notes=notes, unknowns=unknowns, reference=reference, sources=rows.names, magnitude=rows.magnitude,
        rows=rows.rows, distances=np.sqrt(chi2 / sizes), outlier=outlier, influence=influence, tails=best_node.tails,
        scale=best_node.scale, excess=best_node.excess, information=information,
        log_evidence=float(logsumexp([node.log_evidence for node in nodes])),
    )  # fmt: skip


#: How many candidates a short report lists.
_MOST_PLANNED = 8


@dataclass(frozen=True, eq=False)
class LinkPlan(Result):
    """Candidates in the order in which they tell most of a link, each after those before it.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    candidates : tuple of str
        Names of the sources, the best first.
    gain : (n,) array
        ln of the factor by which the volume of the parameters' errors shrinks with each.
    sigma : (n, p) array
        Errors of the parameters when it and all before it have been observed.
    before : (p,) array
        Errors today.
    """

    names: tuple[str, ...]
    candidates: tuple[str, ...]
    gain: FloatArray
    sigma: FloatArray
    before: FloatArray

    def __repr__(self) -> str:
        return f"<LinkPlan: {len(self.candidates)} candidates, {self.candidates[0]} first>"

    def _sections(self, long):
        errors_today = ", ".join(f"{name} {error:.3g}" for name, error in zip(self.names, self.before, strict=True))
        rows = range(len(self.candidates) if long else min(_MOST_PLANNED, len(self.candidates)))
        facts, forms = [("errors today", errors_today)], {"gain": ".3f"}
        return (Section("What to observe next", facts, self.to_table(), rows=rows, forms=forms),)

    def to_table(self) -> Table:
        """The candidates as an astropy Table, a row each."""
        columns: dict[str, Any] = {"source": np.array(self.candidates, dtype=str), "gain": self.gain}
        columns |= {f"sigma_{name}": column for name, column in zip(self.names, self.sigma.T, strict=True)}
        return tables.table_of(columns, {})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Errors against the number of candidates that have been observed, on matplotlib axes."""
        from fit.frames.link._plot import plot_plan

        return plot_plan(self, ax=ax)


@arguments.accepts(solution=arguments.a(FrameTie), candidates=arguments.a(AstrometryRows))
def forecast(solution: FrameTie, candidates: AstrometryRows) -> LinkPlan:
    """Order candidates by what their astrometry, as planned, would add to a link.

    Parameters
    ----------
    solution : FrameTie
        The link today.
    candidates : AstrometryRows
        Rows of the candidates in all catalogues, existing or planned. Only positions, epochs and covariances are used,
        not the values.

    Returns
    -------
    LinkPlan
        The candidates that contribute information, the best first.

    Raises
    ------
    FieldError
        As `link` does.
    DegeneracyError
        If no candidate tells anything.

    Notes
    -----
    Each step takes the candidate with the largest gain of ln det of the inverse covariance. The error model (tails
    and scale) is that found in `solution`, averaged over simulated skies.
    """
    fixed = {name: epoch for name, epoch in solution.fixed.items() if name in candidates.catalogues}
    equations, _ = make_equations(candidates, solution.unknowns, fixed=fixed, aberration=None)
    rows = equations.eliminate_stars(solution.excess, solution.reference)
    tails, n_differences = solution.tails, rows.dims
    mean_weights = (1 - tails.share) * (tails.nu + n_differences) / (tails.nu + n_differences + 2) / solution.scale**2
    information = [w * rows.design[s].T @ rows.design[s] for w, s in zip(mean_weights, rows.source_slices, strict=True)]
    total_information = np.linalg.inv(solution.covariance)
    remaining = list(range(len(information)))
    chosen, gains, sigmas = [], [], []
    while remaining:
        log_det = np.linalg.slogdet(total_information)[1]
        gain = np.array([np.linalg.slogdet(total_information + information[i])[1] - log_det for i in remaining]) / 2
        best_index = int(gain.argmax())
        chosen.append(remaining.pop(best_index))
        gains.append(gain[best_index])
        total_information = total_information + information[chosen[-1]]
        sigmas.append(np.sqrt(np.diag(np.linalg.inv(total_information))))
    names = tuple(rows.names[i] for i in chosen)
    return LinkPlan(solution.names, names, np.array(gains), np.array(sigmas), solution.sigma)
