"""The link of frames: orientation and spin of catalogues against one of them, from stars and quasars in common."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fit.link._likelihood import FAMILIES, FEWER, NORMAL, Node, nodes
from fit.link._prior import LinkPrior
from fit.link._rows import equations
from fit.link._solution import LinkSolution, made
from fit.link._unknowns import Unknowns
from vsh.sky.astrometry import AstrometryRows
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.logs import logged
from vsh.vector import GAIA_EDR3, Vector

#: The epoch that ICRF3's positions are given for (Charlot et al. 2020, A&A 644, A159).
ICRF3_EPOCH = 2015.0
#: Sizes of an excess noise that are tried, in units of the median error of the positions of the reference.
_EXCESS = (0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
#: Across a jet in units of along it.
_ACROSS = (1.0, 0.3, 0.1)
#: Correlations beyond this cannot be told apart.
_ALIKE = 1e-10


@logged("link")
@arguments.accepts(astrometry=arguments.a(AstrometryRows), scale=arguments.positive)
def link(
    astrometry: AstrometryRows,
    reference: str | None = None,
    unknowns: Sequence[str] = ("orientation", "spin"),
    *,
    steps: Sequence[float] = (),
    order: int = 0,
    colour_order: int = 0,
    epoch: float = 2016.0,
    priors: Sequence[LinkPrior] = (),
    robust: bool = True,
    scale: float | None = None,
    excess: bool | None = None,
    fixed: Mapping[str, float] | None = None,
    aberration: Vector | None = GAIA_EDR3,
    parallax: bool = True,
    light_time: bool = True,
) -> LinkSolution:
    """Find how frames of catalogues are turned, and turn, against that of one, from sources that they share.

    Parameters
    ----------
    astrometry : AstrometryRows
        Rows of all catalogues. The true parameters of a source are eliminated; they need not be known.
    reference : str, optional
        The catalogue that is not turned; the one called vlbi or icrf… unless given.
    unknowns : sequence of str
        Some of "orientation", "spin" and "acceleration".
    steps : sequence of float
        Magnitudes at which the frame jumps.
    order, colour_order : int
        Powers of (G − 13) and (colour − 1) that orientation and spin have.
    epoch : float
        The epoch of the orientation. [Julian year]
    priors : sequence of LinkPrior
        What is known of orientation or spin from elsewhere.
    robust : bool
        Heavy tails and outliers, both found from the data; otherwise normal errors.
    scale : float, optional
        By which all errors are multiplied; found from the data unless given.
    excess : bool
        Whether an offset between radio and optical positions is sought too: one a source, of a size common to all,
        along the jet where its direction is given; structure, and errors of calibrators, are such offsets too. Where
        the reference has positions, unless given.
    fixed : dict, optional
        Catalogues whose stars are measured against calibrators with fixed positions, and the epoch of these; the
        reference, at 2015.0, unless given.
    aberration : Vector, optional
        Acceleration of the Solar System, for what the calibrators drift and quasars move; None leaves it out.
    parallax, light_time : bool
        Whether positions of single epochs are displaced by parallax, and motions changed by the time light needs: to
        see what they do.

    Returns
    -------
    LinkSolution
        Orientation ε and spin ω: what a catalogue gives is turned against the reference by ε + ω (t − epoch).

    Raises
    ------
    ParameterError
        If a catalogue or an unknown is not known.
    FieldError
        If sources lack what the unknowns depend on, or positions of one name are apart.
    DegeneracyError
        If the sources cannot tell the unknowns apart.

    Notes
    -----
    D = K x of Lindegren (2020, A&A 633, A1), for any number of catalogues and rows; ε and ω have the signs of his, and
    of `fit.solve_frame`. Errors of sources are independent of each other here: stars that share a calibrator are not.
    """
    given = _reference(astrometry, reference)
    sought = Unknowns(
        tuple(unknowns), tuple(each for each in astrometry.catalogues if each != given), tuple(map(float, steps)),
        order, colour_order, float(epoch),
    )  # fmt: skip
    fixed = {given: ICRF3_EPOCH} if fixed is None else dict(fixed)
    strange = [each for each in fixed if each not in astrometry.catalogues]
    if strange:
        raise ParameterError(f"fixed: no row is of {', '.join(strange)}; there are {', '.join(astrometry.catalogues)}")
    raw, notes = equations(
        astrometry, sought, fixed=fixed, aberration=aberration, parallax=parallax, light_time=light_time
    )
    known = _prior(priors, sought)
    rows = raw.eliminated()
    _check(rows, known, sought.names)
    if excess is None:
        excess = robust and bool(((astrometry.catalogue == given) & astrometry.measured[:, 0]).any())
    families = (FAMILIES if not excess else FEWER) if robust else (NORMAL,)
    listed: list[Node] = []
    offsets: list[tuple[float, float]] = _offsets(astrometry, given) if excess else [(0.0, 1.0)]
    tried = {offset: rows if not offset[0] else raw.eliminated(*offset, given) for offset in offsets}
    for (size, ratio), more in tried.items():
        # As likely as not there is none; all sizes are alike then.
        chance = -np.log(len(offsets) - 1) if size else 0.0
        for node in nodes(more, known, families, scale):
            evidence = node.evidence - more.log_determinant + chance
            listed.append(replace(node, evidence=evidence, excess=size, across=ratio))
    best = max(listed, key=lambda node: node.evidence)
    return made(listed, tried[best.excess, best.across], known, sought, given, (*astrometry.notes, *notes))


def _offsets(astrometry, reference):
    """Sizes of the excess noise, and ratios across jets, that are tried."""
    mine = (astrometry.catalogue == reference) & astrometry.measured[:, 0]
    if not mine.any():
        raise ParameterError(f"an excess noise is of positions, and {reference} has none with errors")
    unit = float(np.sqrt(np.median(astrometry.covariance[mine][:, [0, 1], [0, 1]])))
    ratios = _ACROSS if np.isfinite(astrometry.jet[mine]).any() else (1.0,)
    return [(0.0, 1.0), *((unit * size, ratio) for size in _EXCESS for ratio in ratios)]


def _prior(priors, unknowns):
    """What is known from elsewhere as a normal matrix and its right-hand side."""
    p = len(unknowns.names)
    matrix, rhs = np.zeros((p, p)), np.zeros(p)
    for each in priors:
        turned = unknowns.turned
        catalogue = each.catalogue or (turned[0] if len(turned) == 1 else None)
        if catalogue not in turned or each.vector not in unknowns.vectors:
            what = f"the {each.vector} of {catalogue or 'a catalogue that is not named'}"
            raise ParameterError(f"a prior is of {what}, which is not sought here")
        a = unknowns.combination(each.vector, catalogue, each.magnitude, each.colour)
        weighted = np.linalg.solve(each.covariance, a)
        matrix += a.T @ weighted
        rhs += weighted.T @ each.value
    return matrix, rhs


def _check(rows, prior, names):
    """Raise DegeneracyError, with the names, where the sources cannot tell unknowns apart."""
    matrix = rows.design.T @ rows.design + prior[0]
    size = np.sqrt(np.diag(matrix))
    lost = [name for name, length in zip(names, size, strict=True) if not length > 0]
    if not lost:
        values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
        if values[0] < _ALIKE or len(rows.rhs) < len(names) - np.linalg.matrix_rank(prior[0]):
            part = np.abs(vectors[:, 0])
            lost = [name for name, share in zip(names, part, strict=True) if share > 0.1]
    if lost:
        raise DegeneracyError(
            f"{len(rows.names)} sources with {len(rows.rhs)} differences cannot tell apart {', '.join(lost)}: leave "
            "out unknowns or steps, or give priors"
        )


def _reference(astrometry, reference):
    names = astrometry.catalogues
    likely = [each for each in names if each.lower().startswith(("vlbi", "icrf"))]
    chosen = reference or (likely[0] if len(likely) == 1 else None)
    if chosen not in names:
        said = f"no catalogue is called {chosen}" if chosen else "which of the catalogues is the reference"
        raise ParameterError(f"{said}: there are {', '.join(names)}; say reference= (--reference)")
    if len(names) == 1 and not astrometry.still.any():
        raise ParameterError(f"all rows are of {names[0]}: a link needs another catalogue")
    return chosen
