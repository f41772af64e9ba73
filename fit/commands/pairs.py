"""`vsh-pairs`: the correlation of motions by angle, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import vsh
from vsh.commands import figures, outputs, parsing, parts_options, reading, running

#: As `fit.pairs.TEMPLATES`, which loads too much for --help.
_TEMPLATES = ("spin", "glide", "waves")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-pairs`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    options = parsing.parse(make_parser(), arguments)
    return running.guarded("vsh-pairs", lambda: _run(options), options.threads)


def _run(options):
    outputs.check(options, "vsh-pairs")
    # Not before: --help should not wait for astropy.
    from fit import pairs
    from vsh import catalogue

    if parts_options.in_parts(options):
        field = catalogue.parts(options.catalogue, **parts_options.reading_parts(options)).to_frame(options.frame)
    else:
        field = catalogue.read_field(options.catalogue, roles=(), **reading.arguments(options)).to_frame(options.frame)
    edges = np.radians(np.linspace(0, options.up_to, options.bins + 2))
    found = pairs.correlation(field, edges, lmax=options.lmax, nside=options.nside)
    fitted = found.fit(options.templates) if options.templates else None
    text = found.report() + ("\n" + fitted.report() if fitted else "")
    power = pairs.power(field, options.powers, nside=options.nside) if options.powers else None
    text += "\n" + power.report() if power else ""
    running.say(text)
    if not (options.output or options.html):
        return
    meta = running.provenance(
        options.catalogue, options, {"vsh-astrometry": vsh.__version__}, sources=found.n_data // 2
    )
    drawn = figures.Figures(lambda: _draw(found, fitted, power))
    if options.output:
        with outputs.results_folder(options.output, "vsh-pairs", meta, options.overwrite) as folder:
            _write(folder, text, found, fitted, power, meta)
            drawn.write(folder, options)
            listed = [x.name for x in folder.iterdir()]
        running.say(running.written(options.output, listed))
    if options.html:
        sheets = {"Correlation by angle": found.to_table()}
        sheets |= {"Templates": fitted.to_table()} if fitted else {}
        sheets |= {"Power by degree": power.to_table()} if power else {}
        title = f"Pairs of {Path(options.catalogue).name}"
        figures.write_page(options.html, title, text, drawn, sheets=sheets, provenance=meta, command=options.command)


def _write(folder, text, found, fitted, power, meta):
    (folder / "report.txt").write_text(text, encoding="utf-8")
    found.write(folder / "pairs.ecsv", meta)
    if fitted is not None:
        fitted.write(folder / "templates.ecsv", meta)
    if power is not None:
        power.write(folder / "power.ecsv", meta)


def _draw(found, fitted, power):
    return {"pairs": found.plot(fitted)} | ({} if power is None else {"power": power.plot()})


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-pairs",
        description="How the motions of sources at an angle are correlated, of any number of sources: without bias from their "
        "errors, whatever these are. Spin, glide and gravitational waves are fitted to the curves.",
        epilog="Example: vsh-pairs crf3.fits --bins 18 --powers 5 --output results",
    )
    parser.add_argument("catalogue", help="FITS, VOTable, ECSV, CSV or Parquet file, or a folder of them")
    parser.add_argument("--bins", type=parsing.count(1), default=14, help="of angle (default: 14)")
    parser.add_argument(
        "--up-to", type=_angle, default=180.0, metavar="DEG", help="the largest angle, degrees (default: 180)"
    )
    parser.add_argument(
        "--lmax", type=parsing.count(1), help="highest degree of the sums; what resolves the bins unless given"
    )
    parser.add_argument(
        "--templates", type=_templates, default=_TEMPLATES, metavar="NAME,…",
        help=f"what is fitted: some of {', '.join(_TEMPLATES)}, or none (default: all)",
    )  # fmt: skip
    parser.add_argument("--powers", type=parsing.count(1), metavar="L", help="powers by degree up to L from pairs, too")
    parser.add_argument(
        "--nside", type=parsing.nside, default=2, help="of the blocks of the sky that errors come from (default: 2)"
    )
    parsing.add_threads(parser)
    parts_options.add_workers(parser)
    reading.add_reading(parser)
    parser.add_argument("--version", action="version", version=f"vsh-pairs {vsh.__version__}")
    return parser


def _angle(text):
    found = parsing.positive(text)
    if found > 180:
        raise argparse.ArgumentTypeError(f"an angle up to 180 degrees is wanted, not {text!r}")
    return found


def _templates(text):
    if text == "none":
        return ()
    names = tuple(name.strip() for name in text.split(","))
    if not set(names) <= set(_TEMPLATES):
        raise argparse.ArgumentTypeError(f"none, or some of {', '.join(_TEMPLATES)} are wanted, not {text!r}")
    return names


if __name__ == "__main__":
    sys.exit(main())
