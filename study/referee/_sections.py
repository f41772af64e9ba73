"""Published analyses of quasar motions, each repeated its own way, and checks: is it the sky, or the instrument?"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fit import pairs
from fit.background import SHAPES, Template, WaveLimit, cross_powers, extend_degrees, floor, shared, wave_limit
from fit.frames.chain import combine_frames
from fit.methods import Recommended
from fit.motions.shear import compare_expansions, expansion
from fit.normal import fit_field, normal_equations, solve, template_fields
from fit.results.quality import SEEN
from fit.results.spectrum import spectrum
from fit.secular_parallax import observer_velocity
from study.referee._quasars import (
    MIN_CLASS_SIZE,
    Quasars,
    clip_quasars,
    compare_classes,
    degree_for,
    find_degree_shift,
    find_method_shift,
    find_most_influential_source,
    select_degree_coefficients,
)
from study.referee._rows import NO_VALUE, Analysis, Check, Row, Value, format_verdict, read_papers
from vsh.classes import Classes
from vsh.field import Field
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, with_redshift
from vsh.tools.digits import format_values
from vsh.tools.errors import DegeneracyError, VshError
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import one_line_text
from vsh.tools.types import Rng

#: Columns that sources are split by, each into so many classes.
_SPLITS = {"redshift": 3, "G": 3, "colour": 3, "visibility periods": 2, "scan strength": 3, "scan direction": 3,
           "RUWE": 2, "parameters solved": 2, "last epoch": 2}  # fmt: skip
_FRAMES = ("galactic", "ecliptic", "icrs")
#: Maps are made of these columns.
_MAP_COLUMNS = ("G", "colour", "visibility periods", "scan strength")


def check_all(quasars: Quasars, headline: Recommended, rng: Rng = 1, earlier: Field | None = None) -> list[Check]:
    """Make all checks; one that could not be asked says why."""
    questions: list[tuple[str, str, Callable[[], dict[str, Any]]]] = [
        *((name, f"independent of {name}", partial(_check_classes_of_column, quasars, name, k, rng))
          for name, k in _SPLITS.items()),
        ("plane", "the same near the Galactic plane", partial(_check_latitude_classes, quasars, rng)),
        *((frame, f"the same in both {frame} halves of the sky", partial(_check_sky_halves, quasars, frame, rng))
          for frame in _FRAMES),
        ("degree", "independent of the maximum degree", partial(_check_degree_dependence, quasars, headline)),
        ("robust", "the same with Student's t and with least squares", partial(_check_method_dependence, quasars, rng)),
        ("one source", "independent of any single source", partial(_check_single_source, quasars)),
        ("maps", "independent of maps of the survey's properties",
         partial(_check_property_maps, quasars, headline, rng)),
    ]  # fmt: skip
    if earlier is not None:
        questions.append(
            ("earlier", "the same in an earlier release", partial(_check_earlier_release, quasars, earlier, rng))
        )
    bar = progress_bar(questions, words="checks", unit="check")
    return [Check(key, question, **_make_contents_or_reason(make_contents)) for key, question, make_contents in bar]


def _make_contents_or_reason(make_contents):
    """Contents of a check or an analysis, or why it could not be made."""
    try:
        return make_contents()
    except VshError as error:
        return {"lacking": str(error)}


def _check_classes_of_column(quasars, name, k, rng):
    return _check_classes(quasars, Classes.by_parts(name, quasars.column(name), k), rng)


def _check_latitude_classes(quasars, rng):
    is_near_plane = np.abs(quasars.field.to_frame("galactic").lat) < np.pi / 6
    return _check_classes(quasars, Classes(("|b| < 30°", "|b| ≥ 30°"), np.array([is_near_plane, ~is_near_plane])), rng)


def _check_sky_halves(quasars, frame, rng):
    return _check_classes(quasars, Classes.by_halves(frame).of(quasars.field), rng)


def _check_classes(quasars, classes, rng) -> dict[str, Any]:
    comparison = compare_classes(quasars, classes, rng)
    verdict = comparison.verdict
    labels = comparison.shared.labels
    difference = comparison.shared.difference(0, len(labels) - 1).acceleration
    difference_text = f"the accelerations of the first and the last differ by {difference.amplitude:.2g} µas/yr"
    return {
        "answer": f"{len(labels)} classes; {difference_text}; largest difference: {verdict.comparison}",
        "p_value": verdict.p_value,
        "at_face_value": comparison.formal_p_value(), "results": {"classes": comparison.shared},
    }  # fmt: skip


def _check_degree_dependence(quasars, headline) -> dict[str, Any]:
    lower_degree = degree_for(len(quasars.field), 3)
    if quasars.degree <= lower_degree:
        raise VshError(f"the sources bear no more than degree {quasars.degree}")
    move, _, p_value = find_degree_shift(quasars.field, lower_degree, quasars.degree, headline.floor)
    formal_p_value = find_degree_shift(quasars.field, lower_degree, quasars.degree, None)[2]
    move_text = ", ".join(f"{component:+.2f}" for component in move)
    answer = f"from maximum degree {lower_degree} to {quasars.degree} the acceleration changes by ({move_text}) µas/yr"
    return {"answer": answer, "p_value": p_value, "at_face_value": formal_p_value}


def _check_method_dependence(quasars, rng) -> dict[str, Any]:
    move, error, p_value = find_method_shift(quasars.whole, rng)
    components = ", ".join(format_values(move, error))
    return {
        "answer": f"Student's t minus least squares, mean of random subsamples: ({components}) µas/yr",
        "p_value": p_value,
    }


def _check_single_source(quasars) -> dict[str, Any]:
    field = quasars.field
    row, size, p = find_most_influential_source(field, degree_for(len(field), 3))
    name = f"row {row}" if field.name is None else one_line_text(field.name[row])
    return {"answer": f"the most influential source, {name}, changes it by {size:.2f} standard errors", "p_value": p}


def _check_earlier_release(quasars, earlier, rng) -> dict[str, Any]:
    """Differences of sources in both, with their common noise and what is systematic in one alone."""
    field = quasars.field
    if field.name is None or earlier.name is None:
        raise VshError("no names (source_id) to find the same sources by")
    common_names = np.intersect1d(np.asarray(field.name, str), np.asarray(earlier.name, str))
    catalogues = {"earlier": earlier.to_frame(field.frame), "now": field}
    samples = {
        name: catalogue[np.isin(np.asarray(catalogue.name, str), common_names)]
        for name, catalogue in catalogues.items()
    }
    chain = combine_frames(samples, degree_for(len(common_names), 5, 3))
    comparison = shared([chain.difference("now")], labels=["now minus earlier"], noise_scale=False, rng=rng)
    change = comparison.solutions[0].acceleration
    components = ", ".join(format_values(change.value, change.sigma))
    answer = (
        f"of {len(common_names)} sources in both, whose noise is correlated by "
        f"{100 * chain.correlation[0, 1]:.0f} %, it changes by ({components}) µas/yr"
    )
    formal_p_value = chain.difference("now").acceleration.p_value
    return {
        "answer": answer, "p_value": comparison.p_value("S"), "at_face_value": formal_p_value,
        "results": {"chain": chain, "shared": comparison},
    }  # fmt: skip


def _check_property_maps(quasars, headline, rng) -> dict[str, Any]:
    field, lmax = quasars.field, min(quasars.degree, 5)
    maps = [Template.density("density", field)]
    for name in _MAP_COLUMNS:
        if name in quasars.columns and np.nanstd(quasars.columns[name]) > 0:
            maps.append(Template.of_sources(name, field.lon, field.lat, quasars.columns[name], field.frame))
    normal = quasars.equations(slice(None), lmax, templates=maps)
    template_fit = shared([normal], labels=["all sources"], noise_scale=quasars.is_scaled, rng=rng)
    acceleration = template_fit.solutions[0].acceleration
    plain_solution = solve(quasars.equations(slice(None), lmax))
    systematic_spectrum = None if headline.floor is None else headline.floor.spectrum
    powers = cross_powers(plain_solution, template_fields(maps, plain_solution.modes, field.frame), systematic_spectrum)
    answer = (
        f"{', '.join(template.name for template in maps)}; marginalised over these maps, the acceleration is "
        f"({', '.join(format_values(acceleration.value, acceleration.sigma))}) µas/yr"
    )
    return {
        "answer": answer, "p_value": _compute_chi2_p_value(template_fit.amplitudes, template_fit.amplitude_covariance),
        "results": {"templates": template_fit, "cross_powers": powers},
    }  # fmt: skip


#: Bins of learnt redshift (Makarov 2025), and of magnitude (Gaia-CRF3).
_Z_EDGES, _G_EDGES = (2.0, 3.0), (18.0, 19.0, 20.0)
_EXPANSION_EDGES = (1.0, 1.5, 2.0, 2.5)
#: A galaxy is nearer than this, and there must be so many.
_MAX_Z, _MIN_GALAXIES = 0.1, 1000
#: Pairs are sorted into so many bins of angle.
_PAIR_BINS = 14


@dataclass(frozen=True, eq=False)
class AnalysisInput:
    """Input of an analysis."""

    quasars: Quasars
    headline: Recommended
    rng: Rng

    @cached_property
    def wave_limit(self) -> WaveLimit:
        """Limit waves with degrees from 2 on and the spectra of systematic errors."""
        normal = self.quasars.normal
        if normal.modes.lmax < 3:
            raise DegeneracyError("degree 2 alone does not tell waves from systematic errors")
        return wave_limit(normal, range(2, normal.modes.lmax + 1), systematics=list(SHAPES.values()))


def _find_published(paper, number_name):
    published_number = read_papers()[paper].numbers.get(number_name)
    if published_number is None:
        return NO_VALUE
    value_type = "limit" if published_number.limit else "size" if number_name.startswith("|") else "value"
    return Value(published_number.value, published_number.error, value_type)


def _make_vector_rows(paper, letter, theirs, ours):
    """Rows of a vector: its components, those published where the axes are theirs, and its size."""
    rows = [
        Row(
            f"{letter}_{axis} [µas/yr]",
            _find_published(paper, f"{letter}_{axis}") if theirs.frame == "icrs" else NO_VALUE,
            Value(theirs.value[k], theirs.sigma[k]), Value(ours.value[k], ours.sigma[k]),
        )
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    name, sizes = f"|{letter}|", (_make_size_or_limit(theirs), _make_size_or_limit(ours))
    return [*rows, Row(f"{name} [µas/yr]", _find_published(paper, name), *sizes)]


def _make_size_or_limit(vector):
    """The size of a vector, or its limit where it is not seen."""
    if vector.p_value < SEEN:
        return Value(vector.amplitude, vector.amplitude_error, "size")
    return Value(vector.amplitude_limit(), kind="limit")


def _make_p_row(quantity, formal_p_value, shared_p_value):
    return Row(f"p, {quantity}", theirs=Value(formal_p_value, kind="p"), shared=Value(shared_p_value, kind="p"))


def _repeat_acceleration(inputs: AnalysisInput) -> dict[str, Any]:
    """Clipped, degree 3, errors by the scatter: Klioner et al. 2021."""
    quasars = inputs.quasars
    clipped_fit = clip_quasars(quasars.whole)
    theirs = clipped_fit.solution.scaled.acceleration
    ours = inputs.headline.acceleration
    rows = _make_vector_rows("klioner2021", "g", theirs, ours)
    for k, name in enumerate(("ra", "dec")):
        if ours.frame == "icrs":
            values = (
                Value(vector.direction[k], vector.direction_error[k]) if vector.p_value < SEEN else NO_VALUE
                for vector in (theirs, ours)
            )
            rows.append(Row(f"{name} [deg]", _find_published("klioner2021", name), *values))
    counts = (Value(float(n)) for n in (clipped_fit.solution.n_sources, len(quasars.whole)))
    rows.append(Row("sources", _find_published("klioner2021", "sources"), *counts))
    return {"rows": rows, "verdict": inputs.headline.answer.sentence, "p_value": ours.p_value}


def _repeat_reference_frame(inputs: AnalysisInput) -> dict[str, Any]:
    """Spin, what is systematic, bright and faint: Gaia-CRF3."""
    quasars, headline = inputs.quasars, inputs.headline
    theirs = fit_field(quasars.field, degree_for(len(quasars.field), 3)).scaled
    rows = _make_vector_rows("crf3", "ω", theirs.spin, headline.solution.spin)
    results, remark = {}, ""
    if (systematic_floor := headline.floor) is not None:
        plain_solution = solve(quasars.normal)
        power = sum(degree.debiased for degree in spectrum(plain_solution) if degree.l > 1)
        fit_rms = Value(float(np.sqrt(max(power, 0) / (4 * np.pi))))
        variances = systematic_floor.spectrum.variances(plain_solution.modes)[plain_solution.modes.degrees > 1]
        floor_rms = Value(float(np.sqrt(sum(variances) / (4 * np.pi))))
        quantity = f"motions of degrees 2–{plain_solution.modes.lmax}, rms [µas/yr]"
        rows.append(Row(quantity, _find_published("crf3", "systematic motions"), fit_rms, floor_rms))
    try:
        comparison = compare_classes(quasars, Classes.by_edges("G", _G_EDGES, quasars.column("G")), inputs.rng)
        p_values = comparison.formal_p_value("T"), comparison.shared.equality("T")
        rows.append(_make_p_row("bright and faint sources have the same spin", *p_values))
        results["magnitudes"] = comparison.shared
    except VshError as error:
        remark = f"; bright and faint sources are not compared: {error}"
    p = headline.spin.p_value
    limit = headline.solution.spin.amplitude_limit()
    verdict = format_verdict(p, f"no spin is detected, < {limit:.3g} µas/yr (95 %)", "the frame of these sources turns")
    return {"rows": rows, "verdict": verdict + remark, "p_value": p, "results": results}


def _repeat_redshift_bins(inputs: AnalysisInput) -> dict[str, Any]:
    """Three bins of redshift, degree 3: Makarov 2025."""
    z = inputs.quasars.column("redshift")
    comparison = compare_classes(inputs.quasars, Classes.by_edges("z", _Z_EDGES, z).within(z >= 1), inputs.rng, lmax=3)
    return _make_redshift_contents(comparison, read_papers()["makarov2025"].words)


def _make_redshift_contents(comparison, published_text):
    verdict = comparison.verdict
    rows = [
        _make_p_row(f"one {name} at all redshifts", comparison.formal_p_value(kind), comparison.shared.equality(kind))
        for kind, name in (("T", "spin"), ("S", "acceleration"))
    ]
    sentence = format_verdict(
        verdict.p_value, "no change with redshift", f"spin or acceleration changes: {verdict.comparison}"
    )
    return {
        "rows": rows, "verdict": f"{sentence}; published: {published_text}", "p_value": verdict.p_value,
        "results": {"classes": comparison.shared},
    }  # fmt: skip


def _repeat_dipole_and_quadrupole(inputs: AnalysisInput) -> dict[str, Any]:
    """Dipole and quadrupole by redshift: Tsigkas Kouvelis et al. 2025."""
    quasars = inputs.quasars
    comparison = compare_classes(quasars, Classes.by_parts("z", quasars.column("redshift"), 4), inputs.rng, lmax=2)
    contents = _make_redshift_contents(comparison, read_papers()["tsigkas2025"].words)
    quadrupole_row, formal_p_value, shared_p_value = _make_quadrupole_row_and_p_values(quasars, inputs.headline)
    contents["rows"].append(quadrupole_row)
    if np.isfinite(shared_p_value):
        null_text = "no quadrupole is detected" if formal_p_value >= SEEN else "the quadrupole is systematic errors"
        sentence = format_verdict(shared_p_value, null_text, "a quadrupole beyond systematic errors")
        contents |= {"verdict": f"{sentence}; {contents['verdict']}", "p_value": shared_p_value}
    return contents


def _make_quadrupole_row_and_p_values(quasars, headline):
    """p-values of no quadrupole: with formal errors, and as one of the degrees that sources share."""
    plain = solve(quasars.normal)
    values, covariance = select_degree_coefficients(plain, 2)
    formal_p_value, shared_p = _compute_chi2_p_value(values, covariance), float("nan")
    # Degrees from 3 on tell systematic errors; the quadrupole must not judge itself.
    if plain.modes.lmax > 3:
        systematic_floor = floor(plain, range(3, plain.modes.lmax + 1))
        systematic_covariance = np.diag(systematic_floor.spectrum.variances(plain.modes)[plain.modes.degrees == 2])
        shared_p = _compute_chi2_p_value(values, covariance * systematic_floor.noise_scale**2 + systematic_covariance)
    return _make_p_row("no quadrupole", formal_p_value, shared_p), formal_p_value, shared_p


def _compute_chi2_p_value(values, covariance):
    return float(chdtrc(len(values), values @ np.linalg.solve(covariance, values)))


def _repeat_expansion(inputs: AnalysisInput) -> dict[str, Any]:
    """Anisotropic expansion in five bins of redshift: Makarov, Heinesen & Schücker 2026."""
    quasars = inputs.quasars
    z = quasars.column("redshift")
    classes = Classes.by_edges("z", _EXPANSION_EDGES, z).within((z >= 0.5) & (z < 3)).of_at_least(MIN_CLASS_SIZE)
    if len(classes) < 2:
        raise DegeneracyError(f"fewer than two bins of {MIN_CLASS_SIZE} sources with redshifts from 0.5 to 3")
    degree = degree_for(min(mask.sum() for _, mask in classes), 5, least=3, per_mode=4)
    masks = [mask for _, mask in classes]
    normals = extend_degrees([quasars.equations(mask, degree) for mask in masks], quasars.equations, masks)
    comparison = compare_expansions(
        normals, [float(z[mask].mean()) for mask in masks], degrees=range(2, degree + 1), labels=classes.labels,
        noise_scale=quasars.is_scaled, rng=inputs.rng,
    )  # fmt: skip
    plain = [expansion(solve(quasars.plain_equations(mask, 2))) for mask in masks]
    rows = [
        Row(f"|Σ|, {label} [µas/yr]", theirs=Value(plain_shear.norm), shared=Value(shear.limit(), kind="limit"))
        for label, plain_shear, shear in zip(classes.labels, plain, comparison.shears, strict=True)
    ]
    smallest = min(range(len(comparison)), key=comparison.p_value)
    rows += [
        _make_p_row(f"no expansion, {classes.labels[smallest]}", plain[smallest].p_value, comparison.p_value(smallest)),
        _make_p_row("the same in all bins", float("nan"), comparison.equality()),
        _make_p_row("no growth with redshift", float("nan"), comparison.growth()),
    ]
    p_value = min(1.0, len(comparison) * comparison.p_value(smallest))
    growth_text = format_verdict(comparison.growth(), "no growth with redshift", "it changes with redshift")
    expansion_text = format_verdict(
        p_value, "no anisotropic expansion beyond systematic errors", "the expansion differs from axis to axis"
    )
    verdict = f"{expansion_text}; {growth_text}; published: {read_papers()['makarov2026'].words}"
    return {"rows": rows, "verdict": verdict, "p_value": p_value, "results": {"expansion": comparison}}


def _repeat_wave_limit(inputs: AnalysisInput) -> dict[str, Any]:
    """Waves longer than the observations, by harmonics and by pairs: Jaraba et al. 2023, Darling 2024."""
    theirs = wave_limit(normal_equations(inputs.quasars.whole, 2)).limit(prior="coefficients")
    harmonics = inputs.wave_limit
    rows = [
        Row(
            "h70² Ω, Gaia DR3 (Jaraba)", _find_published("jaraba2023", "h70² Ω, Gaia"),
            Value(theirs, kind="limit"),
        ),
        Row("h70² Ω, VLBA (Jaraba)", _find_published("jaraba2023", "h70² Ω, VLBA"), Value(theirs, kind="limit")),
        Row(
            "h70² Ω, degree 2", _find_published("darling2024", "h70² Ω, degree 2"), Value(theirs, kind="limit"),
            Value(harmonics.limit(), kind="limit"),
        ),
    ]  # fmt: skip
    verdict = f"gravitational waves: h70² Ω < {harmonics.limit():.3g} (95 %), marginalised over systematic errors"
    return {"rows": rows, "verdict": verdict, "results": {"waves": harmonics}}


def _repeat_waves_by_pairs(inputs: AnalysisInput) -> dict[str, Any]:
    """Waves by pairs beside harmonics: Akhmetov et al. 2026, Darling 2024."""
    quasars = inputs.quasars
    correlation = pairs.correlation_function(quasars.field, np.linspace(0, np.pi, _PAIR_BINS + 2))
    amplitudes = correlation.fit()
    waves_index = amplitudes.names.index("waves")
    (lower, upper), waves_value = amplitudes.interval()[waves_index], Value(*amplitudes["waves"])
    limit_by_harmonics = inputs.wave_limit
    rows = [
        Row("h70² Ω by pairs", theirs=waves_value),
        Row("h70² Ω by pairs, 95 %", _find_published("darling2024", "h70² Ω, pairs"), Value(upper, kind="limit")),
        Row("h70² Ω by harmonics", shared=Value(limit_by_harmonics.limit(), kind="limit")),
    ]
    verdict = (
        f"{lower:.2g} < h70² Ω < {upper:.2g} (95 %) from pairs, where systematic errors count as waves; "
        f"h70² Ω < {limit_by_harmonics.limit():.2g} (95 %) from harmonics"
    )
    return {"rows": rows, "verdict": verdict, "results": {"pairs": correlation}}


def _repeat_error_growth(inputs: AnalysisInput) -> dict[str, Any]:
    """The acceleration with all higher degrees free, and how far its errors grow: Nguyen & Murray 2026."""
    quasars, ours = inputs.quasars, inputs.headline.acceleration
    theirs = solve(quasars.normal).acceleration
    rows = _make_vector_rows("nguyen2026", "g", theirs, ours)
    growth = float(np.mean(ours.sigma / clip_quasars(quasars.whole).solution.acceleration.sigma))
    rows.append(Row("errors of the headline / formal errors, clipped, degree 3", shared=Value(growth)))
    lower, upper = (read_papers()["nguyen2026"][f"errors, {bound}"].value for bound in ("at least", "at most"))
    verdict = (
        f"errors of the acceleration{', systematic errors included,' * (inputs.headline.floor is not None)} are "
        f"{growth:.2f} times the formal errors of a clipped fit to degree 3; published: {lower:g} to {upper:g} "
        "times"
    )
    results = {} if inputs.headline.floor is None else {"floor": inputs.headline.floor}
    return {"rows": rows, "verdict": verdict, "results": results}


def _repeat_galaxy_motions(inputs: AnalysisInput) -> dict[str, Any]:
    """Our motion past galaxies: Maloney et al. 2026."""
    z = inputs.quasars.column("redshift")
    is_near = (z > 0.002) & (z < _MAX_Z)
    if is_near.sum() < _MIN_GALAXIES:
        raise DegeneracyError(f"only {is_near.sum()} sources with z < {_MAX_Z:g}; at least {_MIN_GALAXIES} are needed")
    galaxies = with_redshift(inputs.quasars.field[is_near], redshift_frame="heliocentric")
    theirs, with_flows = (observer_velocity(galaxies, 67.4, flows=flows).velocity for flows in (None, "linear"))
    # What the paper saw none of; the microwave background's dipole says what there is.
    expected_velocity = CMB_VELOCITY_PLANCK18.to_frame(with_flows.frame).value
    rows = [
        Row(f"v_{axis} [km/s], {expected_velocity[k]:+.0f} expected", theirs=Value(theirs.value[k], theirs.sigma[k]),
            shared=Value(with_flows.value[k], with_flows.sigma[k])) for k, axis in enumerate("xyz")
    ]  # fmt: skip
    p = with_flows.p_value
    return {"rows": rows, "verdict": format_verdict(p, "no motion is seen", "our motion is seen"), "p_value": p}


_ANALYSES = (
    ("klioner2021", "The acceleration of the Solar System", _repeat_acceleration),
    ("crf3", "The reference frame: spin, systematic errors, bright and faint sources", _repeat_reference_frame),
    ("makarov2025", "Three bins of redshift", _repeat_redshift_bins),
    ("tsigkas2025", "Dipole and quadrupole by redshift", _repeat_dipole_and_quadrupole),
    ("makarov2026", "Anisotropic expansion by redshift", _repeat_expansion),
    ("darling2024", "Gravitational waves by harmonics", _repeat_wave_limit),
    ("akhmetov2026", "Gravitational waves by pairs", _repeat_waves_by_pairs),
    ("nguyen2026", "The spectrum, and wider errors", _repeat_error_growth),
    ("maloney2026", "Motions of galaxies", _repeat_galaxy_motions),
)


def repeat_all(quasars: Quasars, headline: Recommended, rng: Rng) -> list[Analysis]:
    """Repeat all published analyses; one that cannot be done says why."""
    analyses, inputs = [], AnalysisInput(quasars, headline, rng)
    for key, title, repeat_analysis in progress_bar(_ANALYSES, words="published analyses", unit="analysis"):
        contents = _make_contents_or_reason(partial(repeat_analysis, inputs))
        analyses.append(Analysis(title, read_papers()[key], **contents | {"rows": tuple(contents.get("rows", ()))}))
    return analyses
