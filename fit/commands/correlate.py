"""`vsh-correlate`: what a catalogue's sky cannot separate, on the command line."""

import argparse
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import fit
import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.commands.parsing import FRAME
from vsh.io.sections import Answer, Section
from vsh.tools.errors import VshError


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-correlate",
        description=(
            "Show which parameters are correlated for the positions and errors of a catalogue's "
            "sources, which part of the sky causes a correlation, and how much power of unfitted "
            "degrees leaks into the fit. Positions and errors are enough; no motions are needed."
        ),
        examples=(
            "vsh-correlate catalogue.fits --lmax 2",
            "vsh-correlate catalogue.fits catalogue2.fits --frame galactic --output results",
            "vsh-correlate catalogue.fits --influence omega_y,a_x --leakage 6 --output influence",
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", parsing.A_TABLE)
    add("catalogue2", "second catalogue; its correlations are shown in the other triangle of the matrix", nargs="?")
    add("--lmax", "highest degree of the fit: 1 is spin and acceleration", parsing.count(1), 1)
    add(
        "--influence NAME,NAME",
        "map what drives the correlation of two parameters, or the variance of one | omega_y,a_x; may be repeated",
        _parse_parameter_names,
        action="append",
    )
    add("--leakage L", "compute the bias of the fit that is caused by unfitted degrees up to L", parsing.count(2))
    add(
        "--power-per-degree P",
        "with --leakage: power in each degree and kind (T, S) that is not fitted, (µas/yr)²",
        parsing.parse_not_negative,
        1.0,
    )
    reading.add_workers(parser)
    reading.add_reading(parser)
    return parsing.add_common(parser)


def _parse_parameter_names(text):
    parameters = tuple(name.strip() for name in re.findall(r"[^,()]+(?:\([^)]*\))?", text))
    if len(parameters) not in (1, 2) or not all(parameters) or len(set(parameters)) != len(parameters):
        raise argparse.ArgumentTypeError(f"one or two different names are expected, not {text!r}")
    return parameters


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if options.leakage is not None and options.leakage <= options.lmax:
        parser.error(f"--leakage is the highest degree that is not fitted: more than --lmax {options.lmax}")


_LEAKAGE = (
    "What degrees that are not fitted do to spin and acceleration: their rms bias by a power of 1 (µas/yr)² in one."
)


def _run(options):
    run = finishing.Run(options)
    paths = [path for path in (options.catalogue, options.catalogue2) if path]
    sources = [reading.open_catalogue(path, options) for path in paths]
    if reading.is_in_parts(options) and options.influence:
        raise VshError("--influence looks at every source: it needs the catalogue whole, without --workers")
    fields = [_read_sources(*names, options) for names in zip(paths, sources, strict=True)]
    labels = _make_catalogue_labels(paths)
    parameters: Any = FRAME if options.lmax == 1 else options.lmax
    matrices = fit.correlation.correlation_matrices(fields, parameters, labels=labels)
    remarks = []
    if parameters == FRAME:
        direct_matrices = fit.correlation.correlation_matrices(fields, parameters, labels=labels, solver="frame")
        difference = max(np.abs(a - b).max() for a, b in zip(matrices.matrices, direct_matrices.matrices, strict=True))
        remarks.append(f"The independent solver of degree 1 gives the same correlations to {difference:.0e}.")
    caption = "Correlations of the errors: what a fit to this sky cannot separate."
    parts = [finishing.Part("correlation", matrices, "Correlations", caption, as_table=True)]
    detail_sections = []
    for field, label in zip(fields, labels, strict=True):
        detail_sections.append(_make_lmax_section(field, label, options.lmax))
        for names in options.influence or []:
            parts.append(_make_influence_part(field, label, names, options.lmax))
            detail_sections.append(_make_influence_section(field, label, names, options.lmax))
        if options.leakage:
            leakage = fit.correlation.leakage(field, options.lmax, options.leakage)
            parts.append(finishing.Part(f"leakage_{label}", leakage, f"Leakage, {label}", _LEAKAGE, as_table=True))
            detail_sections.append(_make_leakage_section(leakage, label, options.power_per_degree))
    notes = [f"{label}: {note}" for field, label in zip(fields, labels, strict=True) for note in _list_notes(field)]

    def make_sections(long):
        (section,) = matrices.sections(long=long)
        section = replace(section, remarks=[*section.remarks, *(remarks if long else ())])
        return [section, *detail_sections[:-1], replace(detail_sections[-1], notes=notes)]

    run.finish(
        parts,
        sections=make_sections,
        answer=Answer(tuple(_format_answer_lines(matrices))),
        notes=notes,
        paths=paths,
        counts={"sources": [_count_sources(f) for f in fields]},
        title=f"What the sky of {' and '.join(labels)} cannot separate",
    )


def _list_notes(field):
    return next(iter(field)).notes if isinstance(field, vsh.io.parts.Parts) else field.notes


def _count_sources(field):
    return field.counted() if isinstance(field, vsh.io.parts.Parts) else len(field)


def _format_answer_lines(matrices):
    """The parameters that each sky determines together worst."""
    for k, label in enumerate(matrices.labels):
        value, (parameter_a, parameter_b) = matrices.largest(k)
        yield label, f"largest correlation {value:+.3f}, of {parameter_a} and {parameter_b}"


def _read_sources(path, source, options):
    """Positions and errors, whole or in parts."""
    if reading.is_in_parts(options):
        arguments = reading.parts_arguments(options)
        return vsh.io.catalogue.parts(path, motions=False, sigma=options.sigma, **arguments).to_frame(options.frame)
    catalogue = path if vsh.io.catalogue.is_map(source) else source
    arguments = reading.field_arguments(options)
    return vsh.io.catalogue.read_sources(catalogue, sigma=options.sigma, **arguments).to_frame(options.frame)


def _make_catalogue_labels(paths):
    names = [Path(path).stem for path in paths]
    return names if len(set(names)) == len(names) else [f"{name}_{k}" for k, name in enumerate(names, 1)]


def _make_lmax_section(field, label, lmax):
    rows = fit.correlation.lmax_table(field, max(5, lmax))
    prediction = fit.correlation.predict_covariance(field, lmax)
    table = vsh.io.tables.table_of_rows(("degree", "condition", "largest correlation"), rows)
    vectors = (prediction.spin, prediction.acceleration)
    spin, acceleration = (", ".join(f"{sigma:.3g}" for sigma in vector.sigma) for vector in vectors)
    errors = f"spin ({spin}), acceleration ({acceleration}) µas/yr"
    efficiency = (
        f"{100 * prediction.efficiency:.0f} % of the information of uniformly distributed sources of the same weight"
    )
    facts = [("sources", f"{prediction.n_sources}"), (f"errors, degree {lmax}", f"{errors}; {efficiency}")]
    forms = {"condition": ".4g", "largest correlation": ".3f"}
    return Section(f"{label}: by the highest degree that is fitted", facts, table, forms=forms)


def _make_influence_section(field, label, names, lmax):
    from vsh.sky.pixels import centres
    from vsh.vector import correlation_of

    # Regions of some 30°: single pixels of a fine map say little.
    coarse, (lon, lat) = fit.correlation.influence_map(field, lmax, names, 2), np.degrees(centres(2))
    k = int(np.argmax(np.abs(coarse)))
    if len(names) == 2:
        covariance = fit.correlation.predict_covariance(field, lmax).covariance
        correlation = correlation_of(fit.correlation.select_parameters(names, lmax).covariance(covariance))[0, 1]
        quantity = f"correlation of {names[0]} and {names[1]}, {correlation:+.4f}"
    else:
        quantity = f"ln σ² of {names[0]}"
    region = f"the sky around {lon[k]:.0f}°, {lat[k]:+.0f}°"
    text = f"{region}: doubling the weight of the sources in the pixel there (29° wide) changes it by {coarse[k]:+.4f}"
    return Section(f"{label}: {quantity}", [("depends most on", text)])


def _make_leakage_section(leakage, label, power):
    biases = leakage.bias_of(fit.correlation.parameters_of("spin+acceleration").names, power)
    bias_texts = ", ".join(f"{name} {value:.3g}" for name, value in biases.items())
    degrees = f"degrees {leakage.fitted.lmax + 1} to {leakage.unmodelled.lmax}"
    title = f"{label}: bias of the fit by {degrees}, which are left out"
    facts = [("power", f"{power:g} (µas/yr)² in each of T and S"), ("bias", f"{bias_texts} µas/yr (rms)")]
    return Section(title, facts)


#: HEALPix NSIDE of maps of what drives a correlation.
_INFLUENCE_NSIDE = 16


def _make_influence_part(field, label, names, lmax):
    """The map of an influence as a part of the result."""
    values = fit.correlation.influence_map(field, lmax, names, _INFLUENCE_NSIDE)
    name = f"influence_{label}_{'_'.join(names)}".replace("(", "").replace(")", "").replace(",", "")
    symbols = " and ".join(map(fit.correlation.symbol, names))
    quantity = f"correlation of {symbols}" if len(names) == 2 else f"ln σ² of {symbols}"
    title, unit = f"{label}:\nwhat drives the {quantity}", "its change where the sources (dots) weigh twice"
    metadata = {"ORDERING": "RING", "FRAME": field.frame}
    return finishing.Part(
        name,
        None,
        caption="Which part of the sky causes it: the change if the weight of the sources there were doubled.",
        plot=lambda: fit.correlation.plot_influence(values, field, title, unit),
        files=lambda folder, _: vsh.io.tables.write_columns(folder / f"{name}.fits", {"influence": values}, metadata),
    )


main, run = running.make_entry(__name__, _run)
