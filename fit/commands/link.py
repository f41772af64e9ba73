"""`vsh-link`: frames of Gaia and VLBI over all magnitudes, on the command line."""

import argparse
from pathlib import Path
from typing import Any

from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Section
from vsh.tools.errors import ParameterError


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-link",
        description=(
            "Link frames over all magnitudes: orientation and spin of Gaia against VLBI (or any catalogues) from radio "
            "stars with parallaxes, single epochs, and quasars; outliers by the likelihood, none by hand."
        ),
        examples=(
            "vsh-link gaia.csv vlbi.csv --steps 13 --output link",
            "vsh-link gaia.csv vlbi.csv --order 1",
            "vsh-link gaia.csv vlbi.csv --seek-step --html link.html",
        ),
    )
    add = parsing.adder(parser)
    add(
        "catalogues",
        "table with source names, epochs and any of ra, dec, parallax, pmra, pmdec with their errors | one table per "
        "catalogue, or one with a column 'catalogue' or with suffixes of columns (_VLBI)",
        nargs="+",
        metavar="TABLE",
    )
    add("--reference NAME", "catalogue that defines the frame (default: that called vlbi… or icrf…)")
    add(
        "--unknowns NAMES",
        "unknowns to fit, any of orientation, spin, acceleration, parallax (zero point and scale of the parallaxes) "
        "(default: orientation,spin)",
        parsing.parse_names,
        ["orientation", "spin"],
    )
    add("--epoch", "epoch of the orientation", float, 2016.0)
    add("--steps G,…", "magnitudes at which the frame may jump", parsing.parse_numbers, ())
    add(
        "--seek-step G,…",
        "search for the magnitude of a jump, among these (default: 12 within the magnitudes of the sources)",
        parsing.parse_numbers,
        nargs="?",
        const=(),
    )
    add("--order", "degree of the polynomial in (G − 13)", parsing.count(0, 6), 0)
    add(
        "--priors FILE",
        "table of known spins or orientations, or the folder that vsh-fit --output wrote | columns x, y, z, x_error …, "
        "vector, magnitude; the folder has the spin of quasars",
    )
    add("--no-robust", "assume normal errors instead of heavy tails and outliers")
    add("--scale X", "multiply all errors by X instead of estimating the factor", parsing.parse_positive)
    add("--quasars NAME,…", "tables that contain quasars only", parsing.parse_names, ())
    add(
        "--fixed NAME=EPOCH",
        "catalogues whose calibrators have fixed positions, with the epoch of these",
        parsing.parse_pairs,
    )
    add("--candidates FILE", "planned astrometry, to be ranked by the information that it would add")
    reading.add_output(parser)
    return parsing.add_common(parser)


def _run(options):
    run = finishing.Run(options)
    from fit.frames.link import find_step, forecast, link, read_priors
    from vsh.io.astrometry import read_astrometry
    from vsh.io.tables import write_table

    labels = [Path(path).name.split(".")[0] for path in options.catalogues]
    unknown_labels = sorted({*options.quasars} - {*labels})
    if unknown_labels:
        raise ParameterError(f"no table is called {', '.join(unknown_labels)}: there are {', '.join(labels)}")
    astrometry, *others = (
        read_astrometry(path, still=label in options.quasars)
        for path, label in zip(options.catalogues, labels, strict=True)
    )
    for other in others:
        astrometry = astrometry + other
    fixed_epochs = None if options.fixed is None else {name: _parse_epoch(text) for name, text in options.fixed.items()}
    link_options: dict[str, Any] = {
        "reference": options.reference, "unknowns": options.unknowns, "order": options.order,
        "epoch": options.epoch, "robust": not options.no_robust,
        "scale": options.scale, "priors": read_priors(options.priors) if options.priors else (), "fixed": fixed_epochs,
    }  # fmt: skip
    results: dict[str, Any] = {}
    if options.seek_step is None:
        solution = link(astrometry, steps=options.steps, **link_options)
    else:
        if options.steps:
            raise ParameterError("--steps says where the frame jumps, --seek-step asks where: give one of the two")
        results["steps"] = find_step(astrometry, options.seek_step or None, **link_options)
        solution = results["steps"].solution
    results["link"] = solution
    if options.candidates:
        results["plan"] = forecast(solution, read_astrometry(options.candidates))

    truth = _make_truth_sections(solution, options.catalogues[0])
    headings = {"steps": "Place of the jump", "link": "Link", "plan": "Observe next"}
    parts = [finishing.Part(name, result, headings[name]) for name, result in results.items()]
    parts.append(
        finishing.Part(
            "sources",
            None,
            plot=dict,
            tables=lambda: {"Sources": solution.sources_table()},
            files=lambda folder, meta: write_table(solution.sources_table(), folder / "sources.ecsv", meta),
        )
    )
    printed = [result for name, result in results.items() if name != "link" or "steps" not in results]
    run.finish(
        parts,
        sections=lambda long: [*(section for result in printed for section in result.sections(long=long)), *truth],
        answer=results.get("steps", solution).answer,
        notes=solution.notes,
        paths=[*options.catalogues, *(path for path in (options.priors, options.candidates) if path)],
        counts={"sources": len(solution.sources)},
        title=f"{', '.join(solution.unknowns.turned)} against {solution.reference}",
    )


def _make_truth_sections(solution, path):
    """The truth of a simulated table, with how many errors the solution is from it, as a section."""
    from vsh.io import catalogue

    truth = catalogue.truth_of(path) or {}
    if "orientation" not in truth or not solution.unknowns.turned:
        return []
    # A simulated truth is of Gaia against VLBI, its orientation at 2016.
    sign = -1 if solution.reference.lower().startswith("gaia") else 1
    truth = {name: sign * truth[name].to_frame(solution.frame).value for name in ("orientation", "spin", "jump")}
    truth["orientation"] = truth["orientation"] + (solution.unknowns.epoch - 2016.0) * truth["spin"]
    vectors = {name: solution.vector(name) for name in ("orientation", "spin") if name in solution.unknowns.vectors}
    if len(solution.unknowns.steps) == 1 and "spin" in vectors:
        vectors["jump"], _ = solution.jump(solution.unknowns.steps[0])
    facts = []
    for name, vector in vectors.items():
        true_value = truth[name]
        pairs = zip(true_value, (vector.value - true_value) / vector.sigma, strict=True)
        facts.append(
            (name, ", ".join(f"{value:+.2f} ({deviation:+.1f}σ)" for value, deviation in pairs) + f" {vector.unit}")
        )
    return [Section("Truth, and how many errors the solution is from it", facts)]


def _parse_epoch(text):
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f"--fixed is NAME=EPOCH, such as vlbi=2015, not {text!r}") from None


main, run = running.make_entry(__name__, _run)
