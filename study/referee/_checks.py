"""Questions that a referee asks of any acceleration: is it the sky, or the instrument?"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fit.background import Template, cross_powers, shared
from fit.chain import chain_catalogues
from fit.normal import template_fields
from fit.solving import solve
from study.referee._classes import by_parts, compare, halves, latitude
from study.referee._headline import Headline
from study.referee._quasars import Quasars, degree_for
from study.referee._rows import Check
from study.referee._stability import by_degree, by_method, by_source
from vsh.field import Field
from vsh.tools.errors import VshError
from vsh.tools.printing import in_a_line
from vsh.tools.types import Rng

#: Columns that sources are split by, each into so many classes.
_SPLITS = {"redshift": 3, "G": 3, "colour": 3, "visibility periods": 2, "scan strength": 3, "scan direction": 3,
           "RUWE": 2, "parameters solved": 2, "last epoch": 2}  # fmt: skip
_FRAMES = ("galactic", "ecliptic", "icrs")
#: Maps are made of these columns.
_MAPS = ("G", "colour", "visibility periods", "scan strength")


def checks(quasars: Quasars, headline: Headline, rng: Rng = 1, earlier: Field | None = None) -> list[Check]:
    """All of them; one that could not be asked says why."""
    asked: list[tuple[str, str, Callable[[], dict[str, Any]]]] = [
        *((name, f"the same for all by {name}", partial(_by_column, quasars, name, k, rng))
          for name, k in _SPLITS.items()),
        ("plane", "the same near the Galactic plane", partial(_by_latitude, quasars, rng)),
        *((frame, f"the same in both {frame} halves of the sky", partial(_by_half, quasars, frame, rng))
          for frame in _FRAMES),
        ("degree", "the same whatever the degree", partial(_degree, quasars, headline)),
        ("robust", "the same by Student's t as by least squares", partial(_method, quasars, rng)),
        ("one source", "not made by a single source", partial(_source, quasars)),
        ("maps", "not made by what maps of the survey cause", partial(_templates, quasars, headline, rng)),
    ]  # fmt: skip
    if earlier is not None:
        asked.append(("earlier", "the same in an earlier release", partial(_earlier, quasars, earlier, rng)))
    return [_answered(*each) for each in asked]


def _answered(key, question, act):
    try:
        made = act()
    except VshError as error:
        return Check(key, question, lacking=str(error))
    return Check(key, question, **made)


def _by_column(quasars, name, k, rng):
    return _split(quasars, by_parts(quasars.column(name), k, name), rng)


def _by_latitude(quasars, rng):
    low = np.abs(latitude(quasars, "galactic")) < np.pi / 6
    return _split(quasars, {"|b| < 30°": low, "|b| ≥ 30°": ~low}, rng)


def _by_half(quasars, frame, rng):
    return _split(quasars, halves(quasars, frame), rng)


def _split(quasars, split, rng) -> dict[str, Any]:
    compared = compare(quasars, split, rng)
    verdict = compared.verdict
    labels = compared.shared.labels
    away = compared.shared.difference(0, len(labels) - 1).acceleration
    words = f"{len(labels)} classes, last less first {away.amplitude:.2g} µas/yr in the acceleration"
    return {
        "answer": f"{words}; most: {verdict.comparison}", "p_value": verdict.p_value,
        "at_face_value": compared.at_face_value(), "results": {"classes": compared.shared},
    }  # fmt: skip


def _degree(quasars, headline) -> dict[str, Any]:
    low = degree_for(len(quasars.field), 3)
    if quasars.degree <= low:
        raise VshError(f"the sources bear no more than degree {quasars.degree}")
    move, _, p = by_degree(quasars.field, low, quasars.degree, headline.floor)
    plain = by_degree(quasars.field, low, quasars.degree, None)[2]
    words = f"from degree {low} to {quasars.degree} it moves by ({', '.join(f'{x:+.2f}' for x in move)}) µas/yr"
    return {"answer": words, "p_value": p, "at_face_value": plain}


def _method(quasars, rng) -> dict[str, Any]:
    move, error, p = by_method(quasars.whole, rng)
    listed = ", ".join(f"{x:+.2f} ± {e:.2f}" for x, e in zip(move, error, strict=True))
    return {"answer": f"in random parts it moves by ({listed}) µas/yr", "p_value": p}


def _source(quasars) -> dict[str, Any]:
    field = quasars.field
    row, size, p = by_source(field, degree_for(len(field), 3))
    name = f"row {row}" if field.name is None else in_a_line(field.name[row])
    return {"answer": f"{name} moves it by {size:.2f} of its errors, more than any other", "p_value": p}


def _earlier(quasars, earlier, rng) -> dict[str, Any]:
    """Differences of sources in both, with the noise that the two share and what is systematic in one alone."""
    field = quasars.field
    if field.name is None or earlier.name is None:
        raise VshError("no names (source_id) to find the same sources by")
    both = np.intersect1d(np.asarray(field.name, str), np.asarray(earlier.name, str))
    catalogues = {"earlier": earlier.to_frame(field.frame), "now": field}
    chosen = {name: each[np.isin(np.asarray(each.name, str), both)] for name, each in catalogues.items()}
    chain = chain_catalogues(chosen, degree_for(len(both), 5, 3))
    compared = shared([chain.difference("now")], labels=["now less earlier"], noise_scale=False, rng=rng)
    moved = compared.solutions[0].acceleration
    listed = ", ".join(f"{v:+.2f} ± {s:.2f}" for v, s in zip(moved.value, moved.sigma, strict=True))
    words = (
        f"of {len(both)} sources in both, which share {100 * chain.correlation[0, 1]:.0f} % of noise, it moves by "
        f"({listed}) µas/yr"
    )
    quoted = chain.difference("now").acceleration.p_value
    return {
        "answer": words, "p_value": compared.p_value("S"), "at_face_value": quoted,
        "results": {"chain": chain, "shared": compared},
    }  # fmt: skip


def _templates(quasars, headline, rng) -> dict[str, Any]:
    field, lmax = quasars.field, min(quasars.degree, 5)
    maps = [Template.density("density", field)]
    for name in _MAPS:
        if name in quasars.columns and np.nanstd(quasars.columns[name]) > 0:
            maps.append(Template.of_sources(name, field.lon, field.lat, quasars.columns[name], field.frame))
    normal = quasars.equations(slice(None), lmax, templates=maps)
    beside = shared([normal], labels=["all sources"], noise_scale=quasars.is_scaled, rng=rng)
    amplitudes = beside.amplitudes
    chi2 = amplitudes @ np.linalg.solve(beside.amplitude_covariance, amplitudes)
    moved = beside.solutions[0].acceleration
    plain = solve(quasars.equations(slice(None), lmax))
    spectrum = None if headline.floor is None else headline.floor.spectrum
    crossed = cross_powers(plain, template_fields(maps, plain.modes, field.frame), spectrum)
    words = (
        f"{', '.join(each.name for each in maps)}; with them marginalised g = "
        f"({', '.join(f'{v:+.2f} ± {s:.2f}' for v, s in zip(moved.value, moved.sigma, strict=True))}) µas/yr"
    )
    return {
        "answer": words, "p_value": float(chdtrc(len(amplitudes), chi2)),
        "results": {"templates": beside, "cross_powers": crossed},
    }  # fmt: skip
