"""All fits of the study."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit import CrossCheck, Solution, cross_check
from fit.resample import bootstrap
from fit.robust import clip
from vsh import Field
from vsh.io import tables
from vsh.io.archive import DR3, DR4
from vsh.io.catalogue import Columns, missing_column, read_field
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError, TableError, VshError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import progress_bar
from vsh.tools.types import BoolArray, FloatArray, Rng

#: As in the paper.
KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class DegreeOrSubset(InNotebook):
    """What one fit found, or why it found nothing."""

    name: str
    n_sources: int
    n_clipped: int
    solution: Solution | None
    resampled: Solution | None
    said: str = ""


def fit_sources(name: str, field: Field, lmax: int, n_replicates: int, rng: Rng) -> DegreeOrSubset:
    """Clip, fit and draw again."""
    try:
        clipped = clip(field, lmax, KAPPA)
        solution = bootstrap(clipped.sources(field), lmax, n_replicates, rng, progress=False).resampled_solution
    except VshError as error:
        return DegreeOrSubset(name, len(field), 0, None, None, str(error))
    covariance, quality = solution.covariance * clipped.scatter_factor, clipped.solution
    solution = replace(solution, covariance=covariance, chi2=quality.chi2, notes=quality.notes)
    return DegreeOrSubset(name, len(field), clipped.n_clipped, quality, solution)


_NEEDED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
_FURTHER = ("pmra_pmdec_corr", "phot_g_mean_mag", "nu_eff_used_in_astrometry", "used_for_reference_frame_spin")
#: Fewer sources say nothing.
FEWEST = 100
#: Inside |sin b| = 0.1 stars hide among the quasars.
PLANE = 0.1


@dataclass(frozen=True, eq=False)
class Sources(InNotebook):
    """Sources that can be used."""

    field: Field
    six: BoolArray
    wavenumber: FloatArray | None
    for_spin: BoolArray | None
    label: str


def read_gaia(path: Any) -> Sources:
    """Read quasars from a file in the columns of Gaia's archive.

    Parameters
    ----------
    path : path or table
        File from `vsh-archive gaia-crf3`, or from `vsh-sim crf3`.

    Returns
    -------
    Sources
        Without those that are no single sources or cannot be used otherwise; notes of its field count them.

    Raises
    ------
    TableError
        If a column is missing.
    FieldError
        If no source can be used.
    """
    opened = tables.open_table(path)
    for name in _NEEDED:
        if name not in opened.names:
            raise TableError(f"{opened.label}: {missing_column(name, opened)}")
    solution = next((name for name in (DR4.solution, DR3.solution) if name in opened.names), None)
    wanted = [*_NEEDED, *(name for name in _FURTHER if name in opened.names), *([solution] if solution else [])]
    columns = opened.columns(wanted)
    table = {
        name: np.ma.MaskedArray(values, False if mask is None else mask) for name, (values, mask) in columns.items()
    }
    rows = np.arange(len(table["ra"]))
    units = {name: unit for name, unit in opened.units.items() if name in _NEEDED}
    field = read_field(table | {"row": rows}, Columns(name="row", redshift=None), units, on_bad="drop")
    kept = np.asarray(field.name)
    lacking = [f"no column {name}: no subsets by it" for name in _FURTHER[1:] if name not in opened.names]
    if solution is None:
        lacking.append(f"warning: no column {DR3.solution}: all sources are taken for five-parameter solutions")
    field = field.add_note(*lacking)

    def column(name, fill):
        return None if name not in table else np.ma.filled(table[name].astype(type(fill)), fill)[kept]

    six = np.zeros(len(kept), bool) if solution is None else np.ma.filled(table[solution], 0)[kept] == 95
    return Sources(field, six, column(_FURTHER[2], np.nan), column(_FURTHER[3], False), opened.label)


def subsets(sources: Sources) -> dict[str, BoolArray]:
    """The parts of the sky and of the sources that are fitted, by name, (n,) masks each."""
    field, five = sources.field, ~sources.six
    chosen = {"five parameters": five, "six parameters": sources.six, "all": five | sources.six}
    if field.magnitude is not None:
        g = field.magnitude
        chosen |= {
            "G ≤ 18": five & (g <= 18),
            "18 < G ≤ 19": five & (g > 18) & (g <= 19),
            "19 < G ≤ 20": five & (g > 19) & (g <= 20),
            "G > 20": five & (g > 20),
        }
    if sources.wavenumber is not None and np.isfinite(sources.wavenumber[five]).any():
        nu = sources.wavenumber
        low, high = np.nanquantile(nu[five], [1 / 3, 2 / 3])
        chosen |= {
            "red third": five & (nu < low),
            "middle third": five & (nu >= low) & (nu < high),
            "blue third": five & (nu >= high),
        }
    chosen |= {name: five & mask for name, mask in _places(field).items()}
    if sources.for_spin is not None:
        chosen["used for the frame's spin"] = five & sources.for_spin
    return chosen


def _places(field):
    def latitude(frame):
        return angles(rotation_matrix("icrs", frame) @ triad(field.lon, field.lat)[2])

    l, b = latitude("galactic")
    beta = latitude("ecliptic")[1]
    plane = np.abs(np.sin(b)) < PLANE
    return {
        "without the Galactic plane": ~plane,
        "|b| < 30°": np.abs(b) < np.pi / 6,
        "|b| ≥ 30°": np.abs(b) >= np.pi / 6,
        "north Galactic half": b >= 0,
        "south Galactic half": b < 0,
        "north ecliptic half": beta >= 0,
        "south ecliptic half": beta < 0,
        "north celestial half": field.lat >= 0,
        "south celestial half": field.lat < 0,
        "half toward the centre": np.cos(l) >= 0,
        "half away from it": np.cos(l) < 0,
    }


#: The degree of the paper's main fit.
LMAX = 3


@dataclass(frozen=True, eq=False)
class GaiaStudy(InNotebook):
    """What was found."""

    sources: Sources
    degrees: list[DegreeOrSubset]
    subsets: list[DegreeOrSubset]
    check: CrossCheck

    @property
    def main(self) -> DegreeOrSubset:
        """The fit of degree 3 to all five-parameter sources."""
        return self.degrees[min(LMAX, len(self.degrees)) - 1]


def run_gaia(
    sources: Sources, *, max_lmax: int = 10, n_replicates: int = 500, rng: Rng = 1, progress: bool = True
) -> GaiaStudy:
    """Fit everything that the paper fits.

    Parameters
    ----------
    sources : Sources
        Sources as `read_gaia` gives them.
    max_lmax : int
        The table of degrees goes from 1 to it.
    n_replicates : int
        Replicates of each bootstrap.
    rng : Generator or int
        The source of all randomness.
    progress : bool
        Show a bar, after two seconds.

    Raises
    ------
    DegeneracyError
        If the five-parameter sources cannot bear the main fit.
    """
    five = sources.field[~sources.six]
    chosen = subsets(sources)
    if not len(five):
        raise DegeneracyError(f"{sources.label} holds no five-parameter solutions, which the study is about")
    work: list[Any] = [(f"degree {lmax}", five, lmax) for lmax in range(1, max_lmax + 1)]
    enough = {name: mask for name, mask in chosen.items() if mask.sum() >= FEWEST}
    work += [(name, sources.field[mask], 1 if "half" in name else LMAX) for name, mask in enough.items()]
    # A stream for each row, so that one more does not shift the others.
    streams = generator(rng).spawn(len(work))
    rows = []
    bar = progress_bar(list(zip(work, streams, strict=True)), words="fits", shown=progress)
    for (name, field, lmax), stream in bar:
        rows.append(fit_sources(name, field, lmax, n_replicates, stream))
    degrees, others = rows[:max_lmax], rows[max_lmax:]
    others += [
        DegreeOrSubset(name, int(mask.sum()), 0, None, None, f"{mask.sum()} sources, fewer than {FEWEST}")
        for name, mask in chosen.items()
        if name not in enough
    ]
    study = GaiaStudy(sources, degrees, others, cross_check(five))
    if study.main.solution is None:
        raise DegeneracyError(f"the fit of degree {LMAX} to the five-parameter sources: {study.main.said}")
    return study
