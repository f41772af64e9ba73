"""`vsh-fit`: from a catalogue to spin and acceleration, on the command line."""

import argparse
import hashlib
import platform
import sys
import warnings
from importlib.resources import files
from pathlib import Path

import fit
import vsh
from vsh.errors import VshError
from vsh.frames import FRAMES

DEMO = "demo.fits"


def main(arguments=None):
    """Run `vsh-fit`; returns the exit status: 0, 1 (bad data) or 2 (bad usage)."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.output is not None and not options.output:
        parser.error("--output names no folder")
    if bool(options.catalogue) == options.demo:
        parser.error("name one catalogue, or say --demo")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", vsh.VshWarning)  # the report's notes say it
            _run(options)
    except MemoryError:
        print(f"vsh-fit: error: degree {options.lmax} does not fit into memory: lower --lmax", file=sys.stderr)
        return 1
    except (VshError, OSError) as error:
        print(f"vsh-fit: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("vsh-fit: interrupted", file=sys.stderr)
        return 1
    return 0


def _run(options):
    if options.output:  # a folder that cannot be written is better told before the work than after
        try:
            Path(options.output).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise VshError(f"--output {options.output} cannot be made a folder: {error.strerror}") from error
    path = files("fit") / DEMO if options.demo else Path(options.catalogue)
    # Not before: --help should not wait for astropy.
    from vsh import catalogue, tables

    table = tables.read(path)
    field = catalogue.read_field(table, options.columns, options.units, options.on_bad).to_frame(options.frame)
    solution, kept = _fit(field, vsh.Modes(options.lmax), options)
    name = "the simulated catalogue of the demo" if options.demo else str(path)
    text = fit.report(solution, fit.cross_check(kept), catalogue.truth_of(table), name)
    print(text)
    if options.output:
        folder = Path(options.output)
        (folder / "report.txt").write_text(text, encoding="utf-8")
        meta = _provenance(path, options, len(table), len(field), len(kept))
        fit.export.write_solution(solution, folder / "solution.ecsv", meta)
        fit.export.write_correlation(solution, folder / "correlation.ecsv", meta)
        import matplotlib

        matplotlib.use("agg")  # files, no windows
        fit.export.write_figures(solution, kept, folder)
        print(f"written to {folder}: {', '.join(sorted(x.name for x in folder.iterdir() if x.is_file()))}")


def _fit(field, modes, options):
    """The solution that was asked for, and the sources that went into it."""
    solution = None
    if options.clip is not None or options.threshold is not None:
        clipped = fit.robust.clip(field, modes, options.clip, options.threshold)
        solution, field = clipped.solution, field[clipped.kept].add_note(clipped.solution.notes[-1])
    if options.extra_noise:
        solution = fit.robust.extra_noise(field, modes, scale=options.extra_noise == "scale").solution
    elif options.robust:
        solution = {"student": fit.robust.student_t, "permissive": fit.robust.permissive}[options.robust](
            field, modes
        ).solution
    elif options.bootstrap:
        solution = fit.resample.bootstrap(field, modes, options.bootstrap, options.seed).resampled_solution
    elif options.jackknife:
        solution = fit.resample.jackknife(field, modes, options.jackknife).resampled_solution
    elif solution is None:
        solution = fit.fit_field(field, modes.lmax)
    return solution, field


def _provenance(path, options, rows, read, used):
    import astropy
    import numpy
    import scipy

    return {
        "catalogue": Path(str(path)).name,
        "sha256": hashlib.sha256(Path(str(path)).read_bytes()).hexdigest(),
        "rows": rows,
        "rows_used": used,
        "rows_refused": rows - read,
        "rows_clipped": read - used,
        "options": {key: value for key, value in vars(options).items() if value is not None and key != "output"},
        "versions": {
            "vsh-astrometry": vsh.__version__,
            "python": platform.python_version(),
            "numpy": numpy.__version__,
            "scipy": scipy.__version__,
            "astropy": astropy.__version__,
        },
    }


def _parser():
    parser = argparse.ArgumentParser(
        prog="vsh-fit",
        description="Fit vector spherical harmonics to a catalogue of proper motions: the spin of its frame, the "
        "acceleration of the Solar System, and the power of every degree.",
        epilog="Example: vsh-fit catalogue.fits --lmax 3 --clip 3 --frame galactic --output results",
    )
    parser.add_argument("catalogue", nargs="?", help="FITS, VOTable, ECSV, CSV or Parquet file")
    parser.add_argument("--demo", action="store_true", help="run on a simulated catalogue that comes with the package")
    parser.add_argument("--lmax", type=_degree, default=3, help="highest degree (default: 3)")
    clips = parser.add_mutually_exclusive_group()
    clips.add_argument(
        "--clip", type=_positive, metavar="KAPPA", help="leave out sources farther from the fit than KAPPA medians"
    )
    clips.add_argument("--threshold", type=_positive, metavar="X", help="leave out sources farther than X, in errors")
    errors = parser.add_mutually_exclusive_group()
    errors.add_argument(
        "--robust", choices=["student", "permissive"], help="a likelihood that expects some errors to be wrong"
    )
    errors.add_argument(
        "--extra-noise",
        nargs="?",
        const="add",
        choices=["add", "scale"],
        help="add a variance to every source, by maximum likelihood; with 'scale', a factor on its errors too",
    )
    errors.add_argument("--bootstrap", type=_number, metavar="N", help="errors from N draws of the sources")
    errors.add_argument("--jackknife", type=_nside, metavar="NSIDE", help="errors from leaving out HEALPix blocks")
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap (default: 1)")
    parser.add_argument("--frame", choices=list(FRAMES), default="icrs", help="axes of the result (default: icrs)")
    parser.add_argument(
        "--columns", type=_pairs, metavar="ROLE=NAME,…", help="where the table keeps what: pmra=mu_ra,pmdec=mu_dec"
    )
    parser.add_argument("--units", type=_pairs, metavar="NAME=UNIT,…", help="units of columns: mu_ra=uas/yr")
    parser.add_argument(
        "--on-bad", choices=["raise", "drop"], default="raise", help="rows that cannot be used (default: raise)"
    )
    parser.add_argument("--output", metavar="DIR", help="write report, tables and figures to this folder")
    parser.add_argument("--version", action="version", version=f"vsh-fit {vsh.__version__}")
    return parser


def _degree(text):
    try:
        return vsh.Modes(int(text)).lmax
    except ValueError:
        raise argparse.ArgumentTypeError(f"a whole number of at least 1 is wanted, not {text!r}") from None


def _number(text):
    if not text.isdecimal() or int(text) < 2:
        raise argparse.ArgumentTypeError(f"a whole number of at least 2 is wanted, not {text!r}")
    return int(text)


def _nside(text):
    if not text.isdecimal() or int(text) not in (2**k for k in range(14)):
        raise argparse.ArgumentTypeError(f"a power of two from 1 to 8192 is wanted, not {text!r}")
    return int(text)


def _positive(text):
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not number > 0:
        raise argparse.ArgumentTypeError(f"a positive number is wanted, not {text!r}")
    return number


def _pairs(text):
    pairs = dict(map(str.strip, part.partition("=")[::2]) for part in text.split(","))
    if not all(pairs) or not all(pairs.values()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value,name=value")
    return pairs


if __name__ == "__main__":
    sys.exit(main())
