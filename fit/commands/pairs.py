"""`vsh-pairs`: the correlation of motions by angle, on the command line."""

import argparse
from pathlib import Path

import numpy as np

from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Answer


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-pairs",
        description=(
            "Compute the two-point correlation of proper motions as a function of angular "
            "separation, for any number of sources and without bias from their errors. Spin, glide "
            "and gravitational waves are fitted to the curves."
        ),
        examples=(
            "vsh-pairs catalogue.fits",
            "vsh-pairs catalogue.fits --bins 18 --output results",
            "vsh-pairs catalogue.fits --up-to 60 --bins 6 --html pairs.html",
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", parsing.A_TABLE)
    add("--bins", "number of bins in angular separation", parsing.count(1, 2000), 14)
    add("--up-to DEG", "the largest angle, degrees", _parse_angle, 180.0)
    add("--lmax", "highest degree of the harmonic sums (default: high enough to resolve the bins)", parsing.count(1))
    add(
        "--templates NAME,…",
        f"what is fitted: some of {', '.join(parsing.TEMPLATES)}, or none (default: all)",
        _parse_templates,
        parsing.TEMPLATES,
    )
    add(
        "--nside",
        "HEALPix nside of the blocks of the sky from whose scatter the errors are estimated",
        parsing.parse_nside,
        2,
    )
    reading.add_workers(parser)
    reading.add_reading(parser)
    return parsing.add_common(parser)


def _parse_angle(text):
    angle = parsing.parse_positive(text)
    if angle > 180:
        raise argparse.ArgumentTypeError(f"an angle up to 180 degrees is expected, not {text!r}")
    return angle


def _parse_templates(text):
    if text == "none":
        return ()
    templates = tuple(name.strip() for name in text.split(","))
    if not set(templates) <= set(parsing.TEMPLATES):
        raise argparse.ArgumentTypeError(f"none, or some of {', '.join(parsing.TEMPLATES)} are expected, not {text!r}")
    return templates


def _run(options):
    run = finishing.Run(options)
    source = run.open(options.catalogue)
    from fit import pairs

    field = run.read(source, options.catalogue, roles=()).to_frame(options.frame)
    edges = np.radians(np.linspace(0, options.up_to, options.bins + 2))
    correlation = pairs.correlation_function(field, edges, lmax=options.lmax, nside=options.nside)
    fitted = correlation.fit(options.templates) if options.templates else None

    parts = [
        finishing.Part("pairs", correlation, "Correlation by angle", plot=lambda: correlation.plot(fitted)),
        *([finishing.Part("templates", fitted, "Templates", plot=dict, is_long=True)] if fitted else ()),
    ]
    run.finish(
        parts,
        answer=Answer((("templates", fitted.verdict),)) if fitted else None,  # with the limits of the templates
        notes=correlation.notes,
        paths=options.catalogue,
        counts={"sources": correlation.n_data // 2},
        title=f"Pairs of {Path(options.catalogue).name}",
    )


main, run = running.make_entry(__name__, _run)
