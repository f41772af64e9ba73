"""The link of frames: orientation and spin of catalogues against one of them, and the magnitude where a frame jumps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from fit.frames.link._likelihood import FAMILIES, NORMAL, OFFSET_FAMILIES, Node, iterate_nodes
from fit.frames.link._rows import LinkPrior, Unknowns, make_equations
from fit.frames.link._solution import FrameTie, make_frame_tie
from fit.frames.results import FrameResult
from fit.results.quality import SEEN, WRONG_UNIT_FACTOR
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.sky.astrometry import AstrometryRows
from vsh.tools import arguments
from vsh.tools.digits import format_p_value
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.notes import DOUBT, CodedNote
from vsh.tools.printing import log_calls
from vsh.tools.types import Axes, FloatArray, Table
from vsh.vector import GAIA_EDR3, Vector

#: The epoch that ICRF3's positions are given for (Charlot et al. 2020, A&A 644, A159).
ICRF3_EPOCH = 2015.0
#: Sizes of an excess noise that are tried, in units of the median error of the positions of the reference.
_EXCESS_SIZES = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Correlations beyond this cannot be separated.
_SMALLEST_EIGENVALUE = 1e-10


@log_calls("link")
@arguments.accepts(astrometry=arguments.a(AstrometryRows), scale=arguments.positive)
def link(
    astrometry: AstrometryRows,
    reference: str | None = None,
    unknowns: Sequence[str] = ("orientation", "spin"),
    *,
    steps: Sequence[float] = (),
    order: int = 0,
    epoch: float = 2016.0,
    priors: Sequence[LinkPrior] = (),
    robust: bool = True,
    scale: float | None = None,
    excess: bool | None = None,
    fixed: Mapping[str, float] | None = None,
    aberration: Vector | None = GAIA_EDR3,
    parallax: bool = True,
    light_time: bool = True,
) -> FrameTie:
    """Determine orientation and spin of the frames of catalogues relative to a reference catalogue.

    Parameters
    ----------
    astrometry : AstrometryRows
        Rows of all catalogues. The true parameters of a source are eliminated; they need not be known.
    reference : str, optional
        The catalogue that is not turned. Default: the only one whose name begins with vlbi or icrf, or whose rows name
        calibrators.
    unknowns : sequence of str
        Some of "orientation", "spin", "acceleration", and "parallax" for the zero point and the scale of the parallaxes
        of each catalogue relative to the reference.
    steps : sequence of float
        Magnitudes at which the frame jumps.
    order : int
        Degree of the polynomial in (G − 13) by which orientation and spin vary.
    epoch : float
        The epoch of the orientation. [Julian year]
    priors : sequence of LinkPrior
        What is known of orientation or spin from elsewhere.
    robust : bool
        Heavy tails and outliers, both found from the data; otherwise normal errors.
    scale : float, optional
        By which all errors are multiplied; found from the data unless given.
    excess : bool
        Whether a radio–optical offset of each source is included in the model: drawn from a distribution with one size
        for all sources. Source structure and calibrator errors are absorbed as well. Default: yes, if the fit is robust
        and the reference has positions.
    fixed : dict, optional
        Catalogues whose stars are measured against calibrators with fixed positions, and the epoch of these. Unless
        given those whose name begins with vlbi or icrf or whose rows name calibrators, else the reference, at 2015.0.
    aberration : Vector, optional
        Acceleration of the Solar System, used to correct the apparent drift of calibrators and the proper motions of
        quasars; None: no correction.
    parallax, light_time : bool
        Whether positions of single epochs are displaced by parallax, and motions changed by the time light needs: to
        see what they do.

    Returns
    -------
    FrameTie
        Orientation ε and spin ω: what a catalogue gives is turned against the reference by ε + ω (t − epoch).

    Raises
    ------
    ParameterError
        If a catalogue or an unknown is not known.
    FieldError
        If sources lack what the unknowns depend on, or positions of one name are apart.
    DegeneracyError
        If the sources cannot separate the unknowns.

    Notes
    -----
    D = K x of Lindegren (2020, A&A 633, A1), for any number of catalogues and rows; ε and ω have the signs of his, and
    of `fit.solve_frame`. Errors of sources are independent of each other here: stars that share a calibrator are not.
    """
    reference_name = _choose_reference_name(astrometry, reference)
    link_unknowns = Unknowns(
        tuple(name for name in unknowns if name != "parallax"),
        tuple(name for name in astrometry.catalogues if name != reference_name),
        tuple(map(float, steps)), order, float(epoch), "parallax" in unknowns,
    )  # fmt: skip
    radio_names = _find_radio_names(astrometry)
    is_guessed = fixed is None and not radio_names
    fixed = dict.fromkeys(radio_names or [reference_name], ICRF3_EPOCH) if fixed is None else dict(fixed)
    unknown_names = [catalogue for catalogue in fixed if catalogue not in astrometry.catalogues]
    if unknown_names:
        raise ParameterError(
            f"fixed= names unknown catalogues {', '.join(unknown_names)}; known are {', '.join(astrometry.catalogues)}"
        )
    equations, notes = make_equations(
        astrometry, link_unknowns, fixed=fixed, aberration=aberration, parallax=parallax, light_time=light_time
    )
    prior = _sum_link_priors(priors, link_unknowns)
    rows = equations.eliminate_stars()
    _check_separable(rows, prior, link_unknowns.names, equations)
    if excess is None:
        excess = robust and bool(((astrometry.catalogue == reference_name) & astrometry.measured[:, 0]).any())
    families = (FAMILIES if not excess else OFFSET_FAMILIES) if robust else (NORMAL,)
    nodes: list[Node] = []
    excess_sizes: list[float] = _list_excess_sizes(astrometry, reference_name) if excess else [0.0]
    rows_by_size = {size: equations.eliminate_stars(size, reference_name) if size else rows for size in excess_sizes}
    for size, size_rows in rows_by_size.items():
        # As likely as not there is none; all sizes are alike then.
        log_prior = -np.log(len(excess_sizes) - 1) if size else 0.0
        for node in iterate_nodes(size_rows, prior, families, scale):
            log_evidence = node.log_evidence - size_rows.log_determinant + log_prior
            nodes.append(replace(node, log_evidence=log_evidence, excess=size))
    best_node = max(nodes, key=lambda node: node.log_evidence)
    notes = (*astrometry.notes, *notes)
    if best_node.scale > WRONG_UNIT_FACTOR:
        text = f"residuals are {best_node.scale:.3g} times the errors: are both in the units that were assumed?"
        notes = (*notes, CodedNote(f"warning: {text}", DOUBT))
    if aberration is not None and "acceleration" not in unknowns:
        if is_guessed:
            text = f"calibrators of {reference_name} are taken as fixed: if not, say whose (fixed=, --fixed NAME=2015)"
            notes = (*notes, CodedNote(f"warning: {text}", DOUBT))
        exception = f" of all catalogues but {', '.join(fixed)}, whose calibrators are fixed" if fixed else ""
        correction = f"an acceleration of {aberration.amplitude:.3g} µas/yr is taken from motions and positions"
        notes = (*notes, f"{correction}{exception} (--unknowns orientation,spin,acceleration fits it)")
    frame_tie = make_frame_tie(nodes, rows_by_size[best_node.excess], prior, link_unknowns, reference_name, notes)
    return replace(frame_tie, fixed=fixed)


def _list_excess_sizes(astrometry, reference):
    """List the sizes of the excess noise that are tried, zero first."""
    is_reference = (astrometry.catalogue == reference) & astrometry.measured[:, 0]
    if not is_reference.any():
        raise ParameterError(f"an excess noise is of positions, and {reference} has none with errors")
    median_error = float(np.sqrt(np.median(astrometry.covariance[is_reference][:, [0, 1], [0, 1]])))
    return [0.0, *(median_error * size for size in _EXCESS_SIZES)]


def _sum_link_priors(priors, unknowns):
    """Sum the priors to a normal matrix and its right-hand side."""
    p = len(unknowns.names)
    matrix, rhs = np.zeros((p, p)), np.zeros(p)
    for prior in priors:
        catalogues = unknowns.turned
        catalogue = prior.catalogue or (catalogues[0] if len(catalogues) == 1 else None)
        if catalogue not in catalogues or prior.vector not in unknowns.vectors:
            phrase = f"the {prior.vector} of {catalogue or 'a catalogue that is not named'}"
            raise ParameterError(f"a prior is of {phrase}, which is not sought here")
        if prior.magnitude is None and len(unknowns.terms) > 1 and prior.vector != "acceleration":
            raise ParameterError(
                f"a prior of the {prior.vector} has no magnitude, and the frame that is sought changes with it: say "
                "that of its sources (magnitude=, a column magnitude of --priors)"
            )
        combination = unknowns.combination(prior.vector, catalogue, prior.magnitude)
        product = np.linalg.solve(prior.covariance, combination)
        matrix += combination.T @ product
        rhs += product.T @ prior.value
    return matrix, rhs


#: An unknown of an error of more than this is told by rounding alone. [1/µas]
_ROUNDING = 1e-12


def _check_separable(rows, prior, names, equations):
    """Raise DegeneracyError, with the names, where the sources cannot separate unknowns."""
    matrix = rows.design.T @ rows.design + prior[0]
    roots = np.sqrt(np.diag(matrix))
    mixed = [name for name, root in zip(names, roots, strict=True) if not root > _ROUNDING]
    if not mixed:
        eigenvalues, eigenvectors = np.linalg.eigh(matrix / np.outer(roots, roots))
        if eigenvalues[0] < _SMALLEST_EIGENVALUE or len(rows.rhs) < len(names) - np.linalg.matrix_rank(prior[0]):
            shares = np.abs(eigenvectors[:, 0])
            mixed = [name for name, share in zip(names, shares, strict=True) if share > 0.1]
    if mixed:
        n_both = equations.n_matched
        hint = "leave out unknowns or steps, or give priors" if n_both else equations.describe_matching()
        raise DegeneracyError(
            f"{len(rows.names)} sources, {n_both} of them in two catalogues, cannot separate {', '.join(mixed)}: {hint}"
        )


def _find_radio_names(astrometry):
    """The catalogues that are of radio positions by their names, or by calibrators that their rows name."""
    by_name = [name for name in astrometry.catalogues if name.lower().startswith(("vlbi", "icrf"))]
    return by_name or np.unique(astrometry.catalogue[astrometry.calibrator != ""]).tolist()


def _choose_reference_name(astrometry, reference):
    names, candidates = astrometry.catalogues, _find_radio_names(astrometry)
    name = reference or (candidates[0] if len(candidates) == 1 else None)
    if name not in names:
        reason = f"no catalogue is called {name}" if name else "which of the catalogues is the reference"
        raise ParameterError(f"{reason}: there are {', '.join(names)}; say reference= (--reference)")
    if len(names) == 1 and not astrometry.still.any():
        raise ParameterError(f"all rows are of {names[0]}: a link needs another catalogue")
    return name


#: Places that are tried unless given, and how many sources are left to either side.
_N_PLACES, _N_BESIDE_PLACE = 12, 6


@dataclass(frozen=True, eq=False, kw_only=True)
class StepSearch(FrameResult):
    """Search for the magnitude of a jump, and whether there is one.

    Attributes
    ----------
    places : (m,) array
        Magnitudes from which on the frame is turned otherwise, rising.
    probability : (m,) array
        That of each, if there is one jump, at one of them.
    p_values : (m,) array
        That of no jump at each, of all components together, as if no other had been tried.
    p_value : float
        That of no jump anywhere: the smallest, allowing for all.
    solution : FrameTie
        The link with the most probable step.
    whole : FrameTie
        The link without a step.
    """

    places: FloatArray
    probability: FloatArray
    p_values: FloatArray
    p_value: float
    solution: FrameTie
    whole: FrameTie

    def __repr__(self) -> str:
        return f"<StepSearch: {len(self.places)} places, G = {self.place:.4g} most probable, p = {self.p_value:.2g}>"

    @property
    def answer(self) -> Answer:
        """The result to quote: the link without a step where no jump is detected, and the jump after all places."""
        with_step = dict(self.solution.answer.lines)
        jump = {label: text for label, text in with_step.items() if label.startswith("jump")}
        if self.p_value < SEEN:
            return self.solution.answer
        lines = dict(self.whole.answer.lines)
        errors = lines.pop("errors")
        return Answer(tuple((lines | jump | {"errors": f"{errors}, without a jump"}).items()))

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs of each catalogue that is turned with the reference."""
        return self.solution.pairs

    def vectors(self, one: str | None = None, two: str | None = None) -> dict[str, Vector]:
        """Orientation and spin of the fit that is quoted, by name.

        Parameters
        ----------
        one, two : str, optional
            As for `FrameTie.vectors`.
        """
        return (self.solution if self.p_value < SEEN else self.whole).vectors(one, two)

    @property
    def place(self) -> float:
        """The most probable magnitude."""
        return float(self.places[self.probability.argmax()])

    @property
    def interval(self) -> tuple[float, float]:
        """Range of the most probable places with 68 % together, each half way to those beside it."""
        order = np.argsort(-self.probability, kind="stable")
        most_probable = order[: np.searchsorted(np.cumsum(self.probability[order]), 0.68) + 1]
        edges = np.r_[self.places[0], (self.places[1:] + self.places[:-1]) / 2, self.places[-1]]
        return float(edges[most_probable.min()]), float(edges[most_probable.max() + 1])

    def _sections(self, long):
        lower, upper = self.interval
        p = format_p_value(self.p_value)
        facts = [
            ("jump", f"p = {p} of one as large by chance, at any of {len(self.places)} places"),
            ("place", f"G = {self.place:.4g} is most probable if there is one; 68 %: {lower:.4g} to {upper:.4g}"),
            ("largest", f"p = {format_p_value(float(self.p_values.min()))} of that jump alone, without the search"),
        ]
        sections = self.solution.sections(long=long)
        link_section = replace(sections[0], title=f"With a jump at the most probable place: {sections[0].title}")
        return (Section("Search for a jump", facts, self.to_table() if long else None), link_section, *sections[1:])

    def to_table(self) -> Table:
        """The places as an astropy Table, a row each."""
        columns = {"magnitude": self.places, "probability": self.probability, "p_value": self.p_values}
        return tables.table_of(columns, {"p_value": self.p_value}, {"magnitude": "mag"})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Probability of each place, on matplotlib axes."""
        from fit.frames.link._plot import plot_step_probabilities

        return plot_step_probabilities(self, ax=ax)


@arguments.accepts(astrometry=arguments.a(AstrometryRows))
def find_step(astrometry: AstrometryRows, places: Sequence[float] | None = None, **options: Any) -> StepSearch:
    """Find the magnitude at which a frame jumps, in orientation and spin.

    Parameters
    ----------
    astrometry : AstrometryRows
        Rows of all catalogues, as for `link`.
    places : sequence of float, optional
        Magnitudes to try; 12 between those of the sources, as many to the left of each as to the right of the one
        before, unless given.
    **options
        As `link` takes them.

    Returns
    -------
    StepSearch
        The probability of each place if there is a jump, and that of no jump.

    Raises
    ------
    ParameterError
        If `steps` are given beside it, or there are fewer than two places.
    DegeneracyError
        If there are too few sources, or as `link` does.

    Notes
    -----
    Places are weighed by the evidence of the link with a step there, the jump a priori as wide as its errors times
    one factor for all places (Zellner's g): flat in the jump, the few sources beyond a place near the ends would win
    by what they do not know. The p-value is the smallest times the number of places (Šidák): too large where
    neighbouring ones hold nearly the same sources.
    """
    if "steps" in options:
        raise ParameterError("steps are what is sought: say at which magnitudes with places")
    magnitudes = _choose_step_magnitudes(astrometry) if places is None else np.unique(np.asarray(places, float))
    if magnitudes.ndim != 1 or len(magnitudes) < 2 or not np.isfinite(magnitudes).all():
        raise ParameterError(f"two magnitudes at least are expected as places of a jump, not {places!r}")
    solutions = [link(astrometry, steps=[float(magnitude)], **options) for magnitude in magnitudes]
    pairs = list(zip(solutions, magnitudes.tolist(), strict=True))
    log_determinants = [np.linalg.slogdet(solution.jump_covariance(magnitude))[1] for solution, magnitude in pairs]
    log_evidence = np.array([solution.log_evidence for solution in solutions]) - np.array(log_determinants) / 2
    best_link = solutions[int(log_evidence.argmax())]
    p_values = np.array([solution.jump_p_values(magnitude) for solution, magnitude in pairs])
    search_p_values = -np.expm1(len(magnitudes) * np.log1p(-np.minimum(p_values.min(axis=0), 1 - 1e-16)))
    link_without_step = link(astrometry, **options)
    best_link = replace(best_link, searched=tuple(map(float, search_p_values)))
    return StepSearch(
        places=magnitudes,
        probability=np.exp(log_evidence - logsumexp(log_evidence)),
        p_values=p_values[:, 0],
        p_value=float(search_p_values[0]),
        solution=best_link,
        whole=link_without_step,
    )


def _choose_step_magnitudes(astrometry):
    """Choose magnitudes between those of the sources, some of these left to either side."""
    _, rows = np.unique(astrometry.source, return_index=True)
    magnitudes = np.sort(astrometry.magnitude[rows][np.isfinite(astrometry.magnitude[rows])])
    if len(magnitudes) < 2 * _N_BESIDE_PLACE + 2:
        raise DegeneracyError(
            f"{len(magnitudes)} sources with a magnitude are too few to look for a jump among: "
            f"{2 * _N_BESIDE_PLACE + 2} at least"
        )
    splits = np.unique(np.linspace(_N_BESIDE_PLACE, len(magnitudes) - _N_BESIDE_PLACE, _N_PLACES).astype(int))
    return np.unique((magnitudes[splits - 1] + magnitudes[splits]) / 2)
