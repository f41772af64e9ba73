"""Published analyses of quasar motions, each repeated its own way, and checks: is it the sky, or the instrument?"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from fit import pairs
from fit.background import SHAPES, Template, WaveLimit, cross_powers, floor, shared, wave_limit, widened
from fit.frames.chain import combine_frames
from fit.motions.shear import compare_expansions, expansion
from fit.normal import normal_equations, template_fields
from fit.results.quality import SEEN
from fit.results.spectrum import spectrum
from fit.secular_parallax import observer_velocity
from fit.solving import fit_field, solve
from study.papers import papers
from study.referee._quasars import FEWEST, Quasars, by_degree, by_method, by_source, clip_quasars, compare, degree_for
from study.referee._rows import NONE, Analysis, Check, Headline, Row, Value, format_verdict
from vsh.classes import Classes
from vsh.field import Field
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, with_redshift
from vsh.tools.errors import DegeneracyError, VshError
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
        ("robust", "the same with Student's t and with least squares", partial(_method, quasars, rng)),
        ("one source", "not made by a single source", partial(_source, quasars)),
        ("maps", "not explained by maps of the survey's properties", partial(_templates, quasars, headline, rng)),
    ]  # fmt: skip
    if earlier is not None:
        asked.append(("earlier", "the same in an earlier release", partial(_earlier, quasars, earlier, rng)))
    return [_answer_question(*each) for each in asked]


def _answer_question(key, question, act):
    try:
        made = act()
    except VshError as error:
        return Check(key, question, lacking=str(error))
    return Check(key, question, **made)


def _by_column(quasars, name, k, rng):
    return _split_classes(quasars, Classes.by_parts(name, quasars.column(name), k), rng)


def _by_latitude(quasars, rng):
    low = np.abs(quasars.field.to_frame("galactic").lat) < np.pi / 6
    return _split_classes(quasars, Classes(("|b| < 30°", "|b| ≥ 30°"), np.array([low, ~low])), rng)


def _by_half(quasars, frame, rng):
    return _split_classes(quasars, Classes.by_halves(frame).of(quasars.field), rng)


def _split_classes(quasars, classes, rng) -> dict[str, Any]:
    compared = compare(quasars, classes, rng)
    verdict = compared.verdict
    labels = compared.shared.labels
    away = compared.shared.difference(0, len(labels) - 1).acceleration
    words = (
        f"{len(labels)} classes; the acceleration of the last minus that of the first is {away.amplitude:.2g} µas/yr"
    )
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
    words = f"from degree {low} to {quasars.degree} it changes by ({', '.join(f'{x:+.2f}' for x in move)}) µas/yr"
    return {"answer": words, "p_value": p, "at_face_value": plain}


def _method(quasars, rng) -> dict[str, Any]:
    move, error, p = by_method(quasars.whole, rng)
    listed = ", ".join(f"{x:+.2f} ± {e:.2f}" for x, e in zip(move, error, strict=True))
    return {"answer": f"Student's t minus least squares, mean of random subsamples: ({listed}) µas/yr", "p_value": p}


def _source(quasars) -> dict[str, Any]:
    field = quasars.field
    row, size, p = by_source(field, degree_for(len(field), 3))
    name = f"row {row}" if field.name is None else in_a_line(field.name[row])
    return {"answer": f"the most influential source, {name}, changes it by {size:.2f} standard errors", "p_value": p}


def _earlier(quasars, earlier, rng) -> dict[str, Any]:
    """Differences of sources in both, with their common noise and what is systematic in one alone."""
    field = quasars.field
    if field.name is None or earlier.name is None:
        raise VshError("no names (source_id) to find the same sources by")
    both = np.intersect1d(np.asarray(field.name, str), np.asarray(earlier.name, str))
    catalogues = {"earlier": earlier.to_frame(field.frame), "now": field}
    chosen = {name: each[np.isin(np.asarray(each.name, str), both)] for name, each in catalogues.items()}
    chain = combine_frames(chosen, degree_for(len(both), 5, 3))
    compared = shared([chain.difference("now")], labels=["now minus earlier"], noise_scale=False, rng=rng)
    moved = compared.solutions[0].acceleration
    listed = ", ".join(f"{v:+.2f} ± {s:.2f}" for v, s in zip(moved.value, moved.sigma, strict=True))
    words = (
        f"of {len(both)} sources in both, whose noise is correlated by "
        f"{100 * chain.correlation[0, 1]:.0f} %, it changes by ({listed}) µas/yr"
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


#: Bins of learnt redshift (Makarov 2025), and of magnitude (Gaia-CRF3).
_Z_EDGES, _G_EDGES = (2.0, 3.0), (18.0, 19.0, 20.0)
_EXPANSION_EDGES = (1.0, 1.5, 2.0, 2.5)
#: A galaxy is nearer than this, and there must be so many.
_NEAR, _GALAXIES = 0.1, 1000
#: Pairs are sorted into so many bins of angle.
_BINS = 14


@dataclass(frozen=True, eq=False)
class SectionInput:
    """Input of a section."""

    quasars: Quasars
    headline: Headline
    rng: Rng

    @cached_property
    def wave_limit(self) -> WaveLimit:
        """Limit waves with degrees from 2 on and the spectra of systematic errors."""
        normal = self.quasars.normal
        if normal.modes.lmax < 3:
            raise DegeneracyError("degree 2 alone does not tell waves from systematic errors")
        return wave_limit(normal, range(2, normal.modes.lmax + 1), systematics=list(SHAPES.values()))


def _published_value(paper, name):
    number = papers()[paper].numbers.get(name)
    if number is None:
        return NONE
    kind = "limit" if number.limit else "size" if name.startswith("|") else "value"
    return Value(number.value, number.error, kind)


def _vectors(paper, letter, theirs, shared):
    """Rows of a vector: its components, those published where the axes are theirs, and its size."""
    rows = [
        Row(
            f"{letter}_{axis} [µas/yr]",
            _published_value(paper, f"{letter}_{axis}") if theirs.frame == "icrs" else NONE,
            Value(theirs.value[k], theirs.sigma[k]), Value(shared.value[k], shared.sigma[k]),
        )
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    return [*rows, Row(f"|{letter}| [µas/yr]", _published_value(paper, f"|{letter}|"), _size(theirs), _size(shared))]


def _size(vector):
    """The size of a vector, or its limit where it is not seen."""
    if vector.p_value < SEEN:
        return Value(vector.amplitude, vector.amplitude_error, "size")
    return Value(vector.amplitude_limit(), kind="limit")


def _p_row(quantity, theirs, shared):
    return Row(f"p, {quantity}", theirs=Value(theirs, kind="p"), shared=Value(shared, kind="p"))


def _acceleration(asked: SectionInput) -> dict[str, Any]:
    """Clipped, degree 3, errors by the scatter: Klioner et al. 2021."""
    quasars = asked.quasars
    clipped = clip_quasars(quasars.whole)
    theirs = clipped.solution.scaled.acceleration
    ours = asked.headline.acceleration
    rows = _vectors("klioner2021", "g", theirs, ours)
    for k, name in enumerate(("ra", "dec")):
        if ours.frame == "icrs":
            values = (Value(each.direction[k], each.direction_error[k]) for each in (theirs, ours))
            rows.append(Row(f"{name} [deg]", _published_value("klioner2021", name), *values))
    counts = (Value(float(n)) for n in (clipped.solution.n_sources, len(quasars.whole)))
    rows.append(Row("sources", _published_value("klioner2021", "sources"), *counts))
    return {"rows": rows, "verdict": asked.headline.verdict, "p_value": asked.headline.p_acceleration}


def _frame(asked: SectionInput) -> dict[str, Any]:
    """Spin, what is systematic, bright and faint: Gaia-CRF3."""
    quasars, headline = asked.quasars, asked.headline
    theirs = fit_field(quasars.field, degree_for(len(quasars.field), 3)).scaled
    rows = _vectors("crf3", "ω", theirs.spin, headline.solution.spin)
    results, more = {}, ""
    if (shared := headline.floor) is not None:
        plain = solve(quasars.normal)
        power = sum(row.debiased for row in spectrum(plain) if row.l > 1)
        spread = Value(float(np.sqrt(max(power, 0) / (4 * np.pi))))
        by_floor = float(np.sqrt(sum(shared.spectrum.variances(plain.modes)[plain.modes.degrees > 1]) / (4 * np.pi)))
        rows.append(
            Row(
                f"motions of degrees 2–{plain.modes.lmax}, rms [µas/yr]",
                _published_value("crf3", "systematic motions"),
                spread, Value(by_floor),
            )
        )  # fmt: skip
    try:
        compared = compare(quasars, Classes.by_edges("G", _G_EDGES, quasars.column("G")), asked.rng)
        rows.append(
            _p_row(
                "bright and faint sources have the same spin",
                compared.at_face_value("T"),
                compared.shared.equality("T"),
            )
        )
        results["magnitudes"] = compared.shared
    except VshError as error:
        more = f"; bright and faint not compared: {error}"
    p = headline.p_spin
    below = headline.solution.spin.amplitude_limit()
    verdict = format_verdict(p, f"no spin is seen, below {below:.3g} µas/yr (95 %)", "the frame of these sources turns")
    return {"rows": rows, "verdict": verdict + more, "p_value": p, "results": results}


def _learnt_redshifts(asked: SectionInput) -> dict[str, Any]:
    """Three bins of redshift, degree 3: Makarov 2025."""
    z = asked.quasars.column("redshift")
    compared = compare(asked.quasars, Classes.by_edges("z", _Z_EDGES, z).within(z >= 1), asked.rng, lmax=3)
    return _by_redshift(compared, papers()["makarov2025"].words)


def _by_redshift(compared, words):
    verdict = compared.verdict
    rows = [
        _p_row(f"one {name} at all redshifts", compared.at_face_value(kind), compared.shared.equality(kind))
        for kind, name in (("T", "spin"), ("S", "acceleration"))
    ]
    said = format_verdict(
        verdict.p_value, "no change with redshift", f"spin or acceleration changes: {verdict.comparison}"
    )
    return {
        "rows": rows, "verdict": f"{said}; published: {words}", "p_value": verdict.p_value,
        "results": {"classes": compared.shared},
    }  # fmt: skip


def _position_drift(asked: SectionInput) -> dict[str, Any]:
    """Dipole and quadrupole by redshift: Tsigkas Kouvelis et al. 2025."""
    quasars = asked.quasars
    compared = compare(quasars, Classes.by_parts("z", quasars.column("redshift"), 4), asked.rng, lmax=2)
    made = _by_redshift(compared, papers()["tsigkas2025"].words)
    row, quoted, p = _quadrupole(quasars, asked.headline)
    made["rows"].append(row)
    if np.isfinite(p):
        nothing = "no quadrupole is seen" if quoted >= SEEN else "the quadrupole is systematic errors"
        said = format_verdict(p, nothing, "a quadrupole beyond systematic errors")
        made["verdict"] = f"{said}; {made['verdict']}"
    return made


def _quadrupole(quasars, headline):
    """p-values of no quadrupole: with formal errors, and as one of the degrees that sources share."""
    plain = solve(quasars.normal)
    at = np.flatnonzero(plain.modes.degrees == 2)
    values = plain.values[at]
    covariance = plain.covariance[np.ix_(at, at)]
    theirs = _chi2_p(values, covariance)
    if plain.modes.lmax < 4:
        return _p_row("no quadrupole", theirs, float("nan")), theirs, float("nan")
    # Degrees from 3 on tell systematic errors; the quadrupole must not judge itself.
    others = floor(plain, range(3, plain.modes.lmax + 1))
    scaled = covariance * others.noise_scale**2 + np.diag(others.spectrum.variances(plain.modes)[at])
    p = _chi2_p(values, scaled)
    return _p_row("no quadrupole", theirs, p), theirs, p


def _chi2_p(values, covariance):
    from scipy.special import chdtrc

    return float(chdtrc(len(values), values @ np.linalg.solve(covariance, values)))


def _expansion(asked: SectionInput) -> dict[str, Any]:
    """Anisotropic expansion in five bins of redshift: Makarov, Heinesen & Schücker 2026."""
    quasars = asked.quasars
    z = quasars.column("redshift")
    classes = Classes.by_edges("z", _EXPANSION_EDGES, z).within((z >= 0.5) & (z < 3)).of_at_least(FEWEST)
    if len(classes) < 2:
        raise DegeneracyError(f"fewer than two bins of {FEWEST} sources with redshifts from 0.5 to 3")
    degree = degree_for(min(mask.sum() for _, mask in classes), 5, least=3)
    masks = [mask for _, mask in classes]
    normals = widened([quasars.equations(mask, degree) for mask in masks], quasars.equations, masks)
    result = compare_expansions(
        normals, [float(z[mask].mean()) for mask in masks], degrees=range(2, degree + 1), labels=classes.labels,
        noise_scale=quasars.is_scaled, rng=asked.rng,
    )  # fmt: skip
    plain = [expansion(solve(quasars.plain_equations(mask, 2))) for mask in masks]
    rows = [
        Row(f"|Σ|, {label} [µas/yr]", theirs=Value(each.norm), shared=Value(shear.limit(), kind="limit"))
        for label, each, shear in zip(classes.labels, plain, result.shears, strict=True)
    ]
    smallest = min(range(len(result)), key=result.p_value)
    rows += [
        _p_row(f"no expansion, {classes.labels[smallest]}", plain[smallest].p_value, result.p_value(smallest)),
        _p_row("the same in all bins", float("nan"), result.equality()),
        _p_row("no growth with redshift", float("nan"), result.growth()),
    ]
    p = min(1.0, len(result) * result.p_value(smallest))
    growth = format_verdict(result.growth(), "no growth with redshift", "it changes with redshift")
    quadrupole = format_verdict(p, "no expansion beyond systematic errors", "the expansion differs from axis to axis")
    words = f"{quadrupole}; {growth}; published: {papers()['makarov2026'].words}"
    return {"rows": rows, "verdict": words, "p_value": p, "results": {"expansion": result}}


def _waves(asked: SectionInput) -> dict[str, Any]:
    """Waves longer than the observations, by harmonics and by pairs: Jaraba et al. 2023, Darling 2024."""
    theirs = wave_limit(normal_equations(asked.quasars.whole, 2)).limit(prior="coefficients")
    shared = asked.wave_limit
    rows = [
        Row("h70² Ω, Gaia DR3 (Jaraba)", _published_value("jaraba2023", "h70² Ω, Gaia"), Value(theirs, kind="limit")),
        Row("h70² Ω, VLBA (Jaraba)", _published_value("jaraba2023", "h70² Ω, VLBA"), Value(theirs, kind="limit")),
        Row(
            "h70² Ω, degree 2", _published_value("darling2024", "h70² Ω, degree 2"), Value(theirs, kind="limit"),
            Value(shared.limit(), kind="limit"),
        ),
    ]  # fmt: skip
    verdict = f"h70² Ω < {shared.limit():.3g} (95 %), systematic errors taken away"
    return {"rows": rows, "verdict": verdict, "results": {"waves": shared}}


def _pairs(asked: SectionInput) -> dict[str, Any]:
    """Waves by pairs beside harmonics: Akhmetov et al. 2026, Darling 2024."""
    quasars = asked.quasars
    correlation = pairs.correlation_function(quasars.field, np.linspace(0, np.pi, _BINS + 2))
    fitted = correlation.fit()
    k = fitted.names.index("waves")
    (low, high), value = fitted.interval()[k], Value(*fitted["waves"])
    harmonics = asked.wave_limit
    rows = [
        Row("h70² Ω by pairs", theirs=value),
        Row("h70² Ω by pairs, 95 %", _published_value("darling2024", "h70² Ω, pairs"), Value(high, kind="limit")),
        Row("h70² Ω by harmonics", shared=Value(harmonics.limit(), kind="limit")),
    ]
    verdict = (
        f"pairs see {'something' if low > 0 else 'nothing'} between {low:.2g} and {high:.2g} (95 %), which holds waves "
        f"and systematic errors alike; harmonics, beside it, nothing above {harmonics.limit():.2g}"
    )
    return {"rows": rows, "verdict": verdict, "results": {"pairs": correlation}}


def _spectrum(asked: SectionInput) -> dict[str, Any]:
    """The acceleration with all higher degrees free, and how far its errors grow: Nguyen & Murray 2026."""
    quasars, ours = asked.quasars, asked.headline.acceleration
    theirs = solve(quasars.normal).acceleration
    rows = _vectors("nguyen2026", "g", theirs, ours)
    wider = float(np.mean(ours.sigma / clip_quasars(quasars.whole).solution.acceleration.sigma))
    rows.append(Row("errors of the headline / formal errors of degree 3", shared=Value(wider)))
    low, high = (papers()["nguyen2026"][f"errors, {word}"].value for word in ("at least", "at most"))
    verdict = (
        f"errors that include systematic errors are {wider:.2f} times the formal errors of "
        f"degree 3 of this catalogue; published: {low:g} to {high:g} times"
    )
    results = {} if asked.headline.floor is None else {"floor": asked.headline.floor}
    return {"rows": rows, "verdict": verdict, "results": results}


def _galaxies(asked: SectionInput) -> dict[str, Any]:
    """Our motion past galaxies: Maloney et al. 2026."""
    z = asked.quasars.column("redshift")
    near = (z > 0.002) & (z < _NEAR)
    if near.sum() < _GALAXIES:
        raise DegeneracyError(f"only {near.sum()} sources with z < {_NEAR:g}; at least {_GALAXIES} are needed")
    galaxies = with_redshift(asked.quasars.field[near], redshift_frame="heliocentric")
    quoted, flowing = (observer_velocity(galaxies, 67.4, flows=flows).velocity for flows in (None, "linear"))
    # What the paper saw none of; the microwave background's dipole says what there is.
    ours = CMB_VELOCITY_PLANCK18.to_frame(flowing.frame).value
    rows = [
        Row(f"v_{axis} [km/s], {ours[k]:+.0f} expected", theirs=Value(quoted.value[k], quoted.sigma[k]),
            shared=Value(flowing.value[k], flowing.sigma[k])) for k, axis in enumerate("xyz")
    ]  # fmt: skip
    p = flowing.p_value
    return {"rows": rows, "verdict": format_verdict(p, "no motion is seen", "our motion is seen"), "p_value": p}


class _Analysis(NamedTuple):
    key: str
    title: str
    act: Callable[[SectionInput], dict[str, Any]]


_ANALYSES = (
    _Analysis("klioner2021", "The acceleration of the Solar System", _acceleration),
    _Analysis("crf3", "The reference frame: spin, systematic errors, bright and faint sources", _frame),
    _Analysis("makarov2025", "Three bins of redshift", _learnt_redshifts),
    _Analysis("tsigkas2025", "Dipole and quadrupole by redshift", _position_drift),
    _Analysis("makarov2026", "Anisotropic expansion by redshift", _expansion),
    _Analysis("darling2024", "Gravitational waves by harmonics", _waves),
    _Analysis("akhmetov2026", "Gravitational waves by pairs", _pairs),
    _Analysis("nguyen2026", "The spectrum, and wider errors", _spectrum),
    _Analysis("maloney2026", "Motions of galaxies", _galaxies),
)


def sections(quasars: Quasars, headline: Headline, rng: Rng) -> list[Analysis]:
    """All of them; one that cannot be done says why."""
    done, asked = [], SectionInput(quasars, headline, rng)
    for key, title, act in _ANALYSES:
        try:
            made = act(asked)
        except VshError as error:
            done.append(Analysis(title, papers()[key], lacking=str(error)))
        else:
            done.append(Analysis(title, papers()[key], **made | {"rows": tuple(made["rows"])}))
    return done
