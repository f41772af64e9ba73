"""Several catalogues of one sky in one solution, with their common noise estimated.

Catalogue k sees source s at x_ks = x_s + A_s c_k + e_ks, with c the coefficients of its frame against the reference's
and Cov(e_js, e_ks) = ρ_jk S_js S_ks, S² the covariance that each quotes. The true places x_s are eliminated source by
source, and ρ_jk maximises the likelihood of the differences of j and k: catalogues with observations in common, as each
ICRF and the one before, differ by less than their errors say. The faint may share noise that the bright do not, so that
ρ, and a factor on the errors, are those of sources with similar quoted errors. Differences of any two follow from one
covariance.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fit.background import ClassComparison, compare_classes_jointly
from fit.frames.compare import CLASSES, FEWEST, count_same_values
from fit.frames.results import FrameResult
from fit.normal import normal_equations
from fit.results.quality import MANY, ErrorSource
from fit.results.solution import Solution
from vsh.basis import harmonics
from vsh.coefficients import Coefficients
from vsh.conventions import to_icrf3_terms
from vsh.field import Field
from vsh.io import tables
from vsh.io.sections import Section
from vsh.modes import Modes, as_modes
from vsh.sky.frames import Positions
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, FieldError, FrameError, ParameterError
from vsh.tools.notes import DOUBT, CodedNote, merge_notes
from vsh.tools.printing import log_calls
from vsh.tools.types import Axes, FloatArray, IntArray, Rng, Table
from vsh.tools.units import UAS
from vsh.vector import Vector

__all__ = ["FrameNetwork", "combine_frames"]
#: The most noise that two catalogues may share: of all of it nothing would be left to compare.
_LARGEST_CORRELATION = 0.995
#: A pair has a correlation of its own in a class from so many sources on; fewer degrees of freedom make no errors
#: smaller than those quoted.
_FEWEST_OF_PAIR, _FEWEST_DOF = 10, 30
#: Rounds of common noise and of outliers; what is left out has a chance of less than this in all the catalogue.
_MAX_ROUNDS, _OUTLIER_CHANCE = 12, 0.5
#: What catalogues share over the sky is looked for to this degree.
_FLOOR_MODES = Modes(5)
#: Sources whose harmonics are at hand together.
_CHUNK_SIZE = 2**15


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrameNetwork(FrameResult):
    """Frames of several catalogues against one of them.

    Attributes
    ----------
    labels : tuple of str
        Names of the catalogues, the reference first.
    modes : Modes
    values : (K − 1, p) array
        Coefficients of each less those of the reference. [`unit`]
    covariance : ((K − 1) p, (K − 1) p) array
        That of all of them, errors scaled by the residuals in classes of sources with similar quoted errors.
    correlation : (K, K) array
        ρ, the common noise, of formal errors: of all sources, where classes of them have their own.
    common : (K, K) array
        How many sources any two have in common; on the diagonal how many of each are used.
    chi2 : float
        With the common noise.
    n_data : int
        Numbers that were fitted, those that true places take left out.
    factor : float
        √(χ²/dof).
    names : tuple of str
        Sources that were left out, the farthest first.
    distances : (k,) array
        √χ² of each.
    frame, unit : str
    notes : tuple of str
    shared : ClassComparison or None
        Rotation and glide of each against the reference with systematic errors, in one model:
        what the reference has is in all differences from it.
    """

    labels: tuple[str, ...]
    modes: Modes
    values: FloatArray
    covariance: FloatArray
    correlation: FloatArray
    common: FloatArray
    chi2: float
    n_data: int
    factor: float
    names: tuple[str, ...]
    distances: FloatArray
    frame: str
    unit: str
    notes: tuple[str, ...] = ()
    shared: ClassComparison | None = None

    def __repr__(self) -> str:
        return f"<FrameNetwork: {', '.join(self.labels)}, degree {self.modes.lmax}, {len(self.names)} sources left out>"

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Any two of the catalogues."""
        return tuple(combinations(self.labels, 2))

    def vectors(self, one: str | None = None, two: str | None = None) -> dict[str, Vector]:
        """Rotation and glide of a pair by name, with the systematic floor in their errors where it was estimated.

        Parameters
        ----------
        one, two : str, optional
            The catalogue, and the one that is subtracted; the first two unless given.
        """
        first = one or next(label for label in self.labels if label != two)
        pair = (first, two or next(label for label in self.labels if label != first))
        solution = self.difference(*pair) if self.shared is None else self.frames(*pair)
        return {"rotation": solution.spin, "glide": solution.acceleration}

    @property
    def errors_in_words(self) -> str:
        """Words on the origin of the errors of the answer."""
        words = "one solution of all catalogues, with their common noise"
        if self.shared is None:
            return f"{words}; the systematic floor is not in them (floor=True, --floor)"
        return f"{words} and the systematic floor in rotation and glide, from degrees 2 to {max(self.shared.degrees)}"

    def difference(self, catalogue: str, other: str | None = None) -> Solution:
        """Difference of two catalogues, the second the reference unless given: a `Solution` with its covariance.

        Parameters
        ----------
        catalogue, other : str
            Two of `labels`.

        Raises
        ------
        ParameterError
            If they are not.
        """
        signs = self._make_difference_signs(catalogue, other)
        p = len(self.modes)
        covariance = np.einsum("i,iajb,j->ab", signs[1:], self.covariance.reshape(len(signs) - 1, p, -1, p), signs[1:])
        n_common = self.common[self._index_of(catalogue), self._index_of(self.labels[0] if other is None else other)]
        return Solution(
            coefficients=Coefficients(self.modes, signs[1:] @ self.values),
            covariance=covariance,
            chi2=float("nan"),
            n_data=int(2 * n_common),
            frame=self.frame,
            notes=self.notes,
            errors_from="all catalogues together, with their common noise",
            error_source=ErrorSource.JOINT,
            unit=self.unit,
        )

    def p_value(self, catalogue: str, other: str | None = None, *, beyond: int = 0) -> float:
        """Probability that two catalogues with one frame differ by as much.

        Parameters
        ----------
        catalogue, other : str
            Two of `labels`; the reference is the other unless given.
        beyond : int
            The degree beyond which they may differ by anything: 1 for what is no rotation and no glide.

        Raises
        ------
        ParameterError
            If there are no such catalogues.

        Notes
        -----
        It holds for noise that two catalogues share in the same part whatever the source: with none, half and nine
        tenths shared p < 0.05 came out on .045 to .075 of 200 simulated chains of three, and p is uniform (Kolmogorov
        and Smirnov). Where the bright share and the faint do not, see `fit.compare.compare_catalogues`, whose errors
        are scaled in classes.
        """
        solution = self.difference(catalogue, other)
        high = np.flatnonzero(self.modes.degrees > beyond)
        if not high.size:
            return float("nan")
        chi2 = solution.values[high] @ np.linalg.solve(solution.covariance[np.ix_(high, high)], solution.values[high])
        return float(chdtrc(high.size, chi2))

    def frames(self, catalogue: str, other: str | None = None) -> Solution:
        """Rotation and glide of one catalogue less another's with systematic errors.

        Parameters
        ----------
        catalogue, other : str
            Two of `labels`; the reference is the other unless given.

        Raises
        ------
        ParameterError
            If they are not, or systematic errors were not estimated (`floor=True`).
        """
        if self.shared is None:
            raise ParameterError("systematic errors were not estimated: combine_frames(…, floor=True)")
        return self.shared.combination(self._make_difference_signs(catalogue, other)[1:])

    def _sections(self, long):
        reference, *catalogues = self.labels
        counts = ", ".join(f"{name} {int(n)}" for name, n in zip(self.labels, np.diag(self.common), strict=True))
        scaling_phrase = "; errors are scaled by the residuals, in classes of sources with similar formal errors"
        facts = [("sources", counts)]
        for (i, first), (j, second) in combinations(enumerate(self.labels), 2):
            if self.common[i, j]:
                text = f"{int(self.common[i, j])} sources in common, {100 * self.correlation[i, j]:.0f} % of the noise"
                facts.append((f"{first} and {second}", text))
        facts.append(("residuals", f"{self.factor:.3g} times the errors with the common noise{scaling_phrase}"))
        columns: dict[str, Any] = {}
        for name in catalogues:
            terms = self._compute_terms(reference, name)
            term_names = [term for term in terms if long or term[0] in "RD"]
            columns.setdefault("ICRF3 term", term_names)
            columns[f"{reference} − {name}"] = [terms[term][0] for term in term_names]
            columns[f"{reference} − {name}_error"] = [terms[term][1] for term in term_names]
        table = tables.table_of(columns, {}, {name: self.unit for name in columns if " − " in name})
        remarks = [("R1, R2, R3 are the rotation with the opposite sign: they rotate the axes, not the sources.")]
        if self.names:
            outliers = ", ".join(f"{n} ({d:.0f})" for n, d in list(zip(self.names, self.distances, strict=True))[:8])
            remarks.append(f"{len(self.names)} sources excluded; largest deviations (in standard errors): {outliers}")
        notes = merge_notes(self.notes, () if self.shared is None else self.shared.notes)
        quantity = "position" if self.unit == "µas" else "motion"
        title = f"Differences of {quantity} of {len(self.labels)} catalogues in one solution, {self.frame} axes"
        advice = " Quote these: two catalogues alone know less." * (self.shared is not None)
        remarks.append(f"Errors are from {self.errors_in_words}.{advice}")
        return (Section(title, facts, table, remarks=remarks, notes=notes),)

    def _compute_terms(self, catalogue, other):
        """List ICRF3's terms of one catalogue less another, in degree 1 with systematic errors if sought."""
        solutions = [self.difference(catalogue, other)]
        solutions += [] if self.shared is None else [self.frames(catalogue, other)]
        terms, *degree_one_terms = (to_icrf3_terms(solution.coefficients, solution.sigma) for solution in solutions)
        return terms | (degree_one_terms[0] if degree_one_terms else {})

    def to_table(self) -> Table:
        """A row for each two catalogues and coefficient as an astropy Table; degree 1 with its floor where sought."""
        pairs = [(later, earlier) for earlier, later in combinations(self.labels, 2)]
        solutions = [self.difference(*pair) for pair in pairs]
        p = len(self.modes)
        columns: dict[str, Any] = {
            "catalogue": np.repeat([later for later, _ in pairs], p).tolist(),
            "less": np.repeat([earlier for _, earlier in pairs], p).tolist(),
            "coefficient": [str(mode) for mode in self.modes] * len(pairs),
            "value": np.concatenate([solution.values for solution in solutions]),
            "sigma": np.concatenate([solution.sigma for solution in solutions]),
        }
        if self.shared is not None:
            is_degree_one, frames = np.tile(self.modes.degrees == 1, len(pairs)), [self.frames(*pair) for pair in pairs]
            for name, attribute in (("value", "values"), ("sigma", "sigma")):
                columns[f"{name}_floor"] = np.full(is_degree_one.size, np.nan)
                columns[f"{name}_floor"][is_degree_one] = np.concatenate([getattr(each, attribute) for each in frames])
        units = {name: self.unit for name in columns if name.startswith(("value", "sigma"))}
        return tables.table_of(columns, {"reference": self.labels[0], "frame": self.frame}, units)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The terms of each catalogue against the reference with their errors, on matplotlib axes.

        Rotation and glide have systematic errors in theirs, where that was sought.
        """
        from fit.results.output import plot_terms

        terms = {f"{name} − {self.labels[0]}": self._compute_terms(name, self.labels[0]) for name in self.labels[1:]}
        axes = plot_terms(terms, self.unit, ax=ax)
        if self.shared is not None:
            axes.set_xlabel("R and D with systematic errors")
        return axes

    def _make_difference_signs(self, catalogue, other):
        """Make the signs of a difference: 1 for a catalogue and −1 for the other, the reference unless given, (K,)."""
        signs = np.zeros(len(self.labels))
        signs[self._index_of(catalogue)] += 1
        signs[self._index_of(self.labels[0] if other is None else other)] -= 1
        return signs

    def _index_of(self, label):
        if label not in self.labels:
            raise ParameterError(f"no catalogue is called {label!r}: {', '.join(self.labels)}")
        return self.labels.index(label)


@log_calls("chain of catalogues")
@arguments.accepts(catalogues=arguments.a(Mapping))
def combine_frames(
    catalogues: Mapping[str, Positions | Field],
    lmax: int | Modes = 2,
    *,
    shared_noise: bool = True,
    clip: bool = True,
    floor: bool | None = None,
    rng: Rng = 1,
) -> FrameNetwork:
    """Compare any number of catalogues in one solution, with their common noise.

    Parameters
    ----------
    catalogues : mapping of str to Positions, or of str to Field
        Mapping from catalogue name to catalogue, the reference first; sources are matched by source name. Positions
        are compared at the epoch of the reference where they have motions.
    lmax : int or Modes
        The highest degree: 1 for rotation and glide, 2 for the sixteen terms of the ICRF3 papers, 4 for 48.
    shared_noise : bool
        Whether the correlations of the catalogues' errors are estimated; independent otherwise.
    clip : bool
        Whether outliers are excluded: sources whose deviation is so large that fewer than 0.5 such sources are
        expected in a catalogue of this size.
    floor : bool, optional
        Whether rotation and glide are also given with systematic errors, estimated jointly from degrees 2 to 5 of all
        differences. Default: yes for 100 000 sources or more.
    rng : Generator or int
        The source of all randomness in the draws of systematic errors.

    Raises
    ------
    ParameterError
        If there are fewer than two, or not of one kind.
    FrameError
        If they stand in different frames.
    FieldError
        If one has no names, or the same name twice.
    DegeneracyError
        If sources in common do not determine a frame.

    Notes
    -----
    Charlot et al. (2020, A&A 644, A159) and A&A 706, A342 (2026) compare frames two at a time. Correlations of two
    catalogues, and factors on their errors, are the same for sources with similar quoted errors: five classes of at
    least 30.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 400), np.arcsin(rng.uniform(-1, 1, 400))
    >>> turned = [np.zeros((2, 400)), np.stack([20 * np.cos(lat), np.zeros(400)])]
    >>> one, two = (
    ...     Field(lon, lat, motion + 30 * rng.normal(size=(2, 400)), np.full((2, 400), 30.0), name=np.arange(400))
    ...     for motion in turned
    ... )
    >>> chain = combine_frames({"one": one, "two": two}, 1)
    >>> bool(abs(chain.difference("two").spin.value[2] - 20) < 10)
    True
    """
    modes, labels = as_modes(lmax), tuple(catalogues)
    catalogue_list = list(catalogues.values())
    types = {type(catalogue) for catalogue in catalogue_list}
    if len(catalogue_list) < 2 or len(types) != 1 or not types <= {Positions, Field}:
        raise ParameterError("a chain is two catalogues at least, all Positions or all Fields")
    if len({catalogue.frame for catalogue in catalogue_list}) > 1:
        raise FrameError(
            "catalogues are in different frames "
            f"({', '.join(sorted({catalogue.frame for catalogue in catalogue_list}))}): use to_frame"
        )
    refused = [label for label, each in catalogues.items() if getattr(each, "covariance", None) is not None]
    if refused:
        raise ParameterError(
            f"{', '.join(refused)}: a joint solution does not use a covariance between sources: compare two catalogues"
        )
    sources = _CommonSources(labels, catalogue_list)
    has_floor = sources.n >= MANY if floor is None else floor
    # What is shared over the sky is neither noise nor an outlier.
    noise_modes = _FLOOR_MODES if has_floor and modes.lmax < _FLOOR_MODES.lmax else modes
    noise, kept = _make_independent_noise(sources, len(noise_modes)), np.ones(sources.n, bool)
    for _ in range(_MAX_ROUNDS):
        previous = noise, kept
        values, _, chi2s, factors, *_ = _fit_frames(sources, noise_modes, noise, kept, labels)
        noise = replace(noise, factors=factors)
        if shared_noise:
            noise = _estimate_common_noise(sources, noise_modes, values, kept, noise)
        if clip:
            scale = np.maximum(1.0, factors)[noise.classes]
            kept = chdtrc(np.maximum(sources.n_contrasts, 1), chi2s / scale) > _OUTLIER_CHANCE / max(sources.n, 1)
        if noise.is_near(previous[0]) and (previous[1] == kept).all():
            break
    shared_errors = _estimate_shared_errors(sources, noise, kept, labels, rng) if has_floor else None
    *_, factors, _, _ = _fit_frames(sources, modes, noise, kept, labels)
    copies = _note_copies(sources, labels)
    factors = np.maximum(factors, 1.0) if copies else factors  # what stands twice makes residuals small, and no error
    values, covariance, chi2s, _, chi2, dof = _fit_frames(sources, modes, replace(noise, factors=factors), kept, labels)
    factor = float(np.sqrt(chi2 / dof)) if dof > 0 else float("nan")
    outlier_rows = np.flatnonzero(~kept)[np.argsort(-chi2s[~kept], kind="stable")]
    membership = sources.is_seen[:, kept].astype(int)
    return FrameNetwork(
        labels=labels,
        modes=modes,
        values=values,
        covariance=covariance,
        correlation=noise.correlation_of_all,
        common=(membership @ membership.T).astype(float),
        chi2=float(chi2),
        n_data=int(dof + values.size),
        factor=factor,
        names=tuple(str(sources.names[i]) for i in outlier_rows),
        distances=np.sqrt(np.maximum(chi2s[outlier_rows], 0.0)),  # rounding, where catalogues share nearly all
        frame=sources.frame,
        unit=sources.unit,
        notes=merge_notes(sources.notes, copies),
        shared=shared_errors,
    )


def _note_copies(sources, labels):
    """Note each pair of catalogues with the same values: one of them is no measurement of its own."""
    notes = []
    for (i, a), (j, b) in combinations(enumerate(labels), 2):
        rows = np.flatnonzero(sources.is_seen[i] & sources.is_seen[j])
        if len(rows) and (same := count_same_values(_make_difference_field(sources, i, j, rows, 0.0))) > len(rows) / 2:
            text = f"warning: {same} of {len(rows)} sources have the same values in {a} and {b}: leave one of them out"
            notes.append(CodedNote(text, DOUBT))
    return tuple(notes)


def _estimate_shared_errors(sources, noise, selection, labels, rng):
    """Rotation and glide with systematic errors; errors by the scatter about a fit to degree 5, in classes of error."""
    normal = _sum_equations(sources, _FLOOR_MODES, noise, selection)
    factors = _fit_frames(sources, _FLOOR_MODES, noise, selection, labels, normal)[3]
    matrix, rhs = (np.tensordot(1 / factors, sums, 1) for sums in normal[:2])
    is_common = sources.is_seen[1:, selection] & sources.is_seen[0, selection]
    return compare_classes_jointly(
        matrix[1:, :, 1:],
        rhs[1:],
        _FLOOR_MODES,
        rng=rng,
        labels=tuple(f"{label} − {labels[0]}" for label in labels[1:]),
        n_sources=tuple(map(int, is_common.sum(1))),
        frame=sources.frame,
        unit=sources.unit,
    )


class _CommonSources:
    """Sources that two catalogues at least have: where each sees them, and the root of its covariance."""

    def __init__(self, labels, catalogues):
        reference = catalogues[0]
        is_position = isinstance(reference, Positions)
        self.frame, self.unit = reference.frame, "µas" if is_position else "µas/yr"
        for label, catalogue in zip(labels, catalogues, strict=True):
            if catalogue.name is None:
                raise FieldError(f"{label} has no names to match its sources by")
            if len(np.unique(catalogue.name)) < len(catalogue):
                n_repeated = len(catalogue) - len(np.unique(catalogue.name))
                raise FieldError(f"{n_repeated} names stand twice in {label}: match by position (--match ARCSEC)")
        if is_position:
            catalogues = [catalogue.at_epoch(reference.epoch) for catalogue in catalogues]
        all_names, counts = np.unique(
            np.concatenate([np.asarray(catalogue.name, str) for catalogue in catalogues]), return_counts=True
        )
        self.names = all_names[counts > 1]
        self.n, k = len(self.names), len(catalogues)
        self.is_seen = np.zeros((k, self.n), bool)
        self.lon, self.lat = np.full((2, self.n), np.nan)
        self.places, self.roots = np.zeros((k, 2, self.n)), np.zeros((k, self.n, 2, 2))
        for i, catalogue in enumerate(catalogues):
            source_names = np.asarray(catalogue.name, str)
            slots = np.minimum(np.searchsorted(self.names, source_names), max(self.n - 1, 0))
            rows = np.flatnonzero(self.names[slots] == source_names) if self.n else np.zeros(0, int)
            slots = slots[rows]
            self.is_seen[i, slots] = True
            is_new = np.isnan(self.lon[slots])
            self.lon[slots[is_new]], self.lat[slots[is_new]] = catalogue.lon[rows[is_new]], catalogue.lat[rows[is_new]]
            if is_position:
                p, q, r = triad(self.lon[slots], self.lat[slots])
                offset = triad(catalogue.lon[rows], catalogue.lat[rows])[2] - r
                self.places[i][:, slots] = np.stack([np.sum(offset * p, 0), np.sum(offset * q, 0)]) / UAS
            else:
                self.places[i][:, slots] = catalogue.motion[:, rows]
            self.roots[i, slots] = _compute_covariance_roots(catalogue.sigma[:, rows], catalogue.rho[rows])
        self.n_contrasts = 2 * (self.is_seen.sum(0) - 1)
        single_counts = [
            f"{label} {int(len(catalogue) - membership.sum())}"
            for label, catalogue, membership in zip(labels, catalogues, self.is_seen, strict=True)
        ]
        self.notes = (f"in one catalogue only, and not used: {', '.join(single_counts)}",)

    def compute_residuals(self, values, modes):
        """Compute what the frames leave of the places, (k, 2, n)."""
        fields = [Coefficients(modes, coefficients).at(self.lon, self.lat) for coefficients in values]
        return self.places - np.stack([np.zeros((2, self.n)), *fields])

    def iterate_source_groups(self, classes):
        """Iterate over sources of one class in the same catalogues: the catalogues, the class, and the sources."""
        codes = (2 ** np.arange(len(self.is_seen))) @ self.is_seen
        for code, class_number in sorted({*zip(codes.tolist(), classes.tolist(), strict=True)}):
            rows = np.flatnonzero((codes == code) & (classes == class_number))
            yield np.flatnonzero(self.is_seen[:, rows[0]]), class_number, rows


@dataclass(frozen=True)
class _Noise:
    """The class of quoted error of each source, (n,); of each class ρ, (C, K, K), and χ²/dof, (C,); ρ of all."""

    classes: IntArray
    correlation: FloatArray
    factors: FloatArray
    correlation_of_all: FloatArray

    def is_near(self, other):
        """Return whether another is the same but for what changes nothing."""
        pairs = ((self.correlation, other.correlation), (np.sqrt(self.factors), np.sqrt(other.factors)))
        return all(np.allclose(own_array, other_array, atol=1e-4) for own_array, other_array in pairs)


def _make_independent_noise(sources, n_modes):
    """Make noise that no catalogues share, in classes of quoted error: the faint may be found to share it alone."""
    n_classes = max(1, min(CLASSES, sources.n // max(FEWEST, 2 * n_modes)))
    mean_variance = np.einsum("kiab,kiab->i", sources.roots, sources.roots) / sources.is_seen.sum(0)
    classes = np.empty(sources.n, int)
    for number, members in enumerate(np.array_split(np.argsort(mean_variance, kind="stable"), n_classes)):
        classes[members] = number
    identity = np.eye(len(sources.is_seen))
    return _Noise(classes, np.tile(identity, (n_classes, 1, 1)), np.ones(n_classes), identity)


def _compute_covariance_roots(sigma, rho):
    """Compute the symmetric roots of covariances, (n, 2, 2)."""
    east, north, cross = sigma[0] ** 2, sigma[1] ** 2, rho * sigma[0] * sigma[1]
    s = np.sqrt(np.maximum(east * north - cross**2, 0.0))
    t = np.sqrt(east + north + 2 * s)
    return np.moveaxis(np.array([[east + s, cross], [cross, north + s]]) / t, -1, 0)


def _sum_equations(sources, modes, noise, selection):
    """Sum normal equations of catalogues by class, (C, K, p, K, p) and (C, K, p), with the weights of differences."""
    k, p = len(sources.is_seen), len(modes)
    matrix, rhs = (np.zeros((len(noise.factors), *shape)) for shape in ((k, p, k, p), (k, p)))
    group_weights = []
    for seen_by, class_number, rows in sources.iterate_source_groups(noise.classes):
        correlation = noise.correlation[class_number]
        weights = _weigh_differences(sources.roots[seen_by][:, rows], correlation[np.ix_(seen_by, seen_by)])
        group_weights.append((seen_by, rows, weights))
        if len(seen_by) == 2:  # their difference is all that counts: the sums of a field, whatever its size
            (i, j), kept = seen_by, rows[selection[rows]]
            if len(kept):
                normal = normal_equations(_make_difference_field(sources, i, j, kept, correlation[i, j]), modes)
                for row, column, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                    matrix[class_number, row, :, column] += sign * normal.matrix
                rhs[class_number, i] += normal.rhs
                rhs[class_number, j] -= normal.rhs
            continue
        for start in range(0, len(rows), _CHUNK_SIZE):
            chunk = slice(start, start + _CHUNK_SIZE)
            kept, chunk_weights = rows[chunk][selection[rows[chunk]]], weights[chunk][selection[rows[chunk]]]
            basis, places = harmonics(sources.lon[kept], sources.lat[kept], modes), sources.places[seen_by][:, :, kept]
            for i, row in enumerate(seen_by):
                for j, column in enumerate(seen_by):
                    product = np.einsum("pam,mab->pbm", basis, chunk_weights[:, i, :, j])
                    matrix[class_number, row, :, column] += product.reshape(p, -1) @ basis.reshape(p, -1).T
                    rhs[class_number, row] += product.reshape(p, -1) @ places[j].ravel()
    return matrix, rhs, group_weights


def _fit_frames(sources, modes, noise, selection, labels, equations=None):
    """Fit coefficients, their covariance, χ² of each source, χ²/dof of each class, all χ², and its degrees of freedom.

    The errors of each class are multiplied by the root of its factor; `normal` are equations that are at hand.
    """
    k, p = len(labels), len(modes)
    matrix, rhs, group_weights = equations or _sum_equations(sources, modes, noise, selection)
    class_matrices = matrix[:, 1:, :, 1:].reshape(len(matrix), (k - 1) * p, -1) / noise.factors[:, None, None]
    total_matrix = class_matrices.sum(0)
    scale = np.sqrt(np.diag(total_matrix))
    if not (scale > 0).all() or np.linalg.cond(total_matrix / np.outer(scale, scale)) > 1e10:
        raise DegeneracyError(
            f"sources in common do not determine all frames of {', '.join(labels)} to this degree: lower it, or leave "
            "out a catalogue that shares few"
        )
    covariance = np.linalg.inv(total_matrix)
    values = (covariance @ np.tensordot(1 / noise.factors, rhs[:, 1:], 1).ravel()).reshape(k - 1, p)
    chi2s, residuals = np.zeros(sources.n), sources.compute_residuals(values, modes)
    for seen_by, rows, w in group_weights:
        chi2s[rows] = np.einsum(
            "iam,miajb,jbm->m", residuals[seen_by][:, :, rows], w, residuals[seen_by][:, :, rows], optimize=True
        )
    chi2, dof = (
        np.bincount(noise.classes[selection], terms[selection], len(matrix)) for terms in (chi2s, sources.n_contrasts)
    )
    dof = dof - np.einsum("ij,cji->c", covariance, class_matrices)
    factors = np.where((dof > 0) & (chi2 > 1e-12 * dof), chi2 / np.maximum(dof, 1e-300), 1.0)
    factors = np.where(dof < _FEWEST_DOF, np.maximum(factors, 1.0), factors)
    return values, covariance, chi2s, factors, float(chi2.sum()), float(dof.sum())


def _make_difference_field(sources, i, j, rows, rho):
    """Make a field of the differences of two catalogues, with their common noise."""
    total, cross = _sum_pair_covariances(sources, i, j, rows)
    covariance = total - rho * cross
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    difference = sources.places[i][:, rows] - sources.places[j][:, rows]
    return Field(sources.lon[rows], sources.lat[rows], difference, sigma, covariance[:, 0, 1] / (sigma[0] * sigma[1]))


def _sum_pair_covariances(sources, i, j, rows):
    """Sum the covariances of two catalogues, and find what noise that both share takes from it: (n, 2, 2) each."""
    root_i, root_j = sources.roots[i, rows], sources.roots[j, rows]
    cross = root_i @ np.swapaxes(root_j, 1, 2)
    return root_i @ root_i + root_j @ root_j, cross + np.swapaxes(cross, 1, 2)


def _weigh_differences(root, correlation):
    """Compute inverse covariances of what catalogues see of each source, its true place eliminated: (m, h, 2, h, 2)."""
    h, m = root.shape[:2]
    covariance = np.einsum("ij,imab,jmcb->miajc", correlation, root, root)
    w = np.linalg.inv(covariance.reshape(m, 2 * h, 2 * h)).reshape(m, h, 2, h, 2)
    row_sums = w.sum(3)  # W E, E the sum over catalogues
    return w - np.einsum("miab,mbc,mjdc->miajd", row_sums, np.linalg.inv(row_sums.sum(1)), row_sums, optimize=True)


def _estimate_common_noise(sources, modes, values, selection, noise):
    """The noise with ρ of each pair in each class by the likelihood of its differences."""
    residuals, p = sources.compute_residuals(values, modes), len(modes)
    overall_correlation = _fit_noise_correlation(sources, residuals, selection, np.eye(len(sources.is_seen)), p)
    correlations = [
        _fit_noise_correlation(sources, residuals, selection, overall_correlation, p, noise.classes == number)
        for number in range(len(noise.factors))
    ]
    return replace(noise, correlation=np.array(correlations), correlation_of_all=overall_correlation)


def _fit_noise_correlation(sources, residuals, selection, default_correlation, n_modes, is_member=True):
    """Fit ρ of each pair of catalogues, of few sources `default_correlation`; the nearest that all can have."""
    from scipy.optimize import minimize_scalar  # slow to import

    k = len(sources.is_seen)
    correlation = np.array(default_correlation)
    for i, j in combinations(range(k), 2):
        is_in_pair = selection & sources.is_seen[i] & sources.is_seen[j]
        rows = np.flatnonzero(is_in_pair & is_member)
        if len(rows) < _FEWEST_OF_PAIR or is_in_pair.sum() <= n_modes:
            continue
        d = residuals[i][:, rows] - residuals[j][:, rows]
        d *= np.sqrt(2 * is_in_pair.sum() / (2 * is_in_pair.sum() - n_modes))  # the fit has taken its part
        total, cross = _sum_pair_covariances(sources, i, j, rows)

        def loss(rho, total=total, cross=cross, d=d):
            v = total - rho * cross
            det = v[:, 0, 0] * v[:, 1, 1] - v[:, 0, 1] ** 2
            chi2 = (v[:, 1, 1] * d[0] ** 2 - 2 * v[:, 0, 1] * d[0] * d[1] + v[:, 0, 0] * d[1] ** 2) / det
            return float(np.sum(chi2 + np.log(det)))

        optimum = minimize_scalar(loss, bounds=(0.0, _LARGEST_CORRELATION), method="bounded", options={"xatol": 1e-5})
        correlation[i, j] = correlation[j, i] = optimum.x
    eigenvalues, eigenvectors = np.linalg.eigh(correlation)
    if eigenvalues[0] < 1e-3:
        correlation = eigenvectors * np.maximum(eigenvalues, 1e-3) @ eigenvectors.T
    return correlation / np.sqrt(np.outer(np.diag(correlation), np.diag(correlation)))
