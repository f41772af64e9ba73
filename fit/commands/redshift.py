"""`vsh-drift`: our velocity, the Hubble constant and dipoles in redshift bins, on the command line."""

import argparse
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

import vsh
from vsh.checks.notes import dropped
from vsh.commands import outputs, shell
from vsh.cosmology import PLANCK_2018
from vsh.errors import ConvergenceError, VshError
from vsh.vector import Vector


def main(arguments=None):
    """Run `vsh-drift`; returns the exit status: 0, 1 (bad data) or 2 (bad usage)."""
    parser = _parser()
    options = shell.parse(parser, arguments)
    if options.checkpoint and not options.posterior:
        parser.error("--checkpoint is for --posterior")
    if not (options.hubble or options.velocity or options.bins or options.posterior):
        parser.error("say what is wanted: --hubble H0, --velocity planck, --bins EDGES, --posterior")
    if (
        options.checkpoint
        and options.output
        and Path(options.output).resolve() in Path(options.checkpoint).resolve().parents
    ):
        parser.error("keep the checkpoint outside the folder of results, which is replaced as a whole")
    return shell.guarded("vsh-drift", lambda: _run(options))


def _run(options):
    if options.output:
        outputs.check_folder(options.output, "vsh-drift", options.overwrite)
    # Not before: --help should not wait for astropy and emcee.
    from fit.secular_parallax import hubble_constant, observer_velocity, report_bins, report_drift
    from vsh import catalogue, tables
    from vsh.cosmology import with_redshift

    source = tables.open_table(options.catalogue)
    whole = catalogue.read_field(source, **shell.reading(options)).to_frame(options.frame)
    if whole.redshift is None:
        raise VshError(
            f"{options.catalogue} has no column of redshifts: name it, --columns redshift=NAME. "
            f"The table has {', '.join(source.names)}"
        )
    refused = dropped(whole.notes)
    counts = {"rows": len(whole) + refused, "rows_read": len(whole)}
    if options.clip:
        whole = _clipped(whole, options.clip)
    cosmology = _cosmology(options)
    results, texts, truth = {}, [], catalogue.truth_of(source)
    if options.bins:
        results["bins"] = _binned(whole, options)
        texts.append(report_bins(results["bins"], chances=_chances(whole, results["bins"])))
    common = {"cosmology": cosmology, "peculiar": options.peculiar, "spin": "free" if options.free_spin else None}
    if options.hubble or options.velocity or options.posterior:
        field = with_redshift(whole) if options.on_bad == "drop" else whole
    if options.hubble:
        results["velocity"] = observer_velocity(field, options.hubble, **common)
        texts.append(report_drift(results["velocity"], options.catalogue, truth))
    if options.velocity:
        results["hubble"] = hubble_constant(field, options.velocity, **common)
        texts.append(report_drift(results["hubble"], options.catalogue, truth))
    for text in texts:
        shell.say(text)
    unfinished = None
    if options.posterior:
        try:
            found = _posterior(field, options, common)
            texts.append(found.report() + "\n")
            results["posterior"] = found
        except ConvergenceError as error:  # what else was found is written all the same
            unfinished = error
            texts.append(f"posterior: {error}\n")
        shell.say(texts[-1])
    if options.output:
        meta = shell.provenance(options.catalogue, options, {"vsh-astrometry": vsh.__version__}, **counts)
        with outputs.results_folder(options.output, "vsh-drift", meta, options.overwrite) as folder:
            _write(results, "\n".join(texts), folder, meta)
            listed = [x.name for x in folder.iterdir()]
        shell.say(shell.written(options.output, listed))
    if unfinished is not None:
        raise unfinished


def _cosmology(options):
    if options.omega_m is None:
        return None
    from vsh.cosmology import flat

    return flat(options.omega_m)


def _binned(field, options):
    from fit.redshift import binned

    edges = int(options.bins[0]) if len(options.bins) == 1 else options.bins
    return binned(field, options.lmax, edges, "higher" if options.common else None)


def _clipped(field, kappa):
    """The sources that agree with a fit of degree 1."""
    from fit.robust import clip

    clipped = clip(field, vsh.Modes(1), kappa)
    return field[clipped.kept].add_note(clipped.solution.notes[-1])


def _chances(field, bins):
    """By permuting redshifts, for up to so many sources."""
    from fit.redshift import chances_by_shuffling

    wanted = bins.modes.lmax == 1 and len(bins) > 1 and len(field) <= 20_000
    known = PLANCK_2018 if np.isfinite(bins.nearness).all() else None
    return chances_by_shuffling(field, bins, velocity=known) if wanted else None


def _posterior(field, options, common):
    from fit.posterior import Flat, Normal, sample

    hubble = Normal(options.hubble, options.hubble_error) if options.hubble and options.hubble_error else "flat"
    if options.hubble_range:
        hubble = Flat(*options.hubble_range)
    if options.free_peculiar:
        common = common | {"peculiar": Flat(0.0, options.free_peculiar)}
    prior = options.velocity or PLANCK_2018
    if not prior.covariance.any():  # a speed without an error is taken to a thousandth, a direction to 0.001°
        l, b = prior.direction
        prior = Vector.from_polar(prior.amplitude, l, b, (1e-3 * prior.amplitude, 1e-3, 1e-3), "galactic", "km/s")
    return sample(field, prior, hubble, options.samples, options.seed, options.checkpoint, **common)


def _write(results, text, folder, meta):
    import matplotlib

    matplotlib.use("agg")  # files, no windows
    from vsh import tables
    from vsh.sky.plot import save_figures

    (folder / "report.txt").write_text(text, encoding="utf-8")
    figures = {}
    if "bins" in results:
        tables.write_table(results["bins"].to_table(), folder / "bins.ecsv", meta)
        figures["bins"] = results["bins"].plot
    for name in ("velocity", "hubble"):
        if name in results:
            found = results[name]
            columns = {"parameter": list(found.names), "value": found.values, "sigma": found.sigma}
            columns |= {f"correlation_{each}": column for each, column in zip(found.names, found.correlation.T)}
            tables.write(folder / f"{name}.ecsv", columns, meta | {"frame": found.frame, "notes": list(found.notes)})
    if "posterior" in results:
        rows = results["posterior"].summary()
        columns = {"quantity": list(rows)} | {
            key: [getattr(row, key) for row in rows.values()] for key in next(iter(rows.values()))._fields
        }
        tables.write(folder / "posterior.ecsv", columns, meta)
        results["posterior"].write(folder / "samples.fits", {"CATALOG": str(meta["catalogue"])})
        figures |= {"corner": results["posterior"].corner, "trace": results["posterior"].trace}
    save_figures({name: draw() for name, draw in figures.items()}, folder)


def _parser():
    parser = argparse.ArgumentParser(
        prog="vsh-drift",
        description="Our velocity for a known Hubble constant, the Hubble constant for a known velocity, the posterior of "
        "both, and spin and acceleration in bins of redshift, from a catalogue of proper motions and redshifts.",
        epilog="Example: vsh-drift galaxies.fits --hubble 67.4 --velocity planck --bins 0.001,0.01,0.03 --output results",
    )
    parser.add_argument("catalogue", help="FITS, VOTable, ECSV, CSV or Parquet file, or a folder of them")
    parser.add_argument("--hubble", type=shell.positive, metavar="H0", help="km/s/Mpc: fit our velocity")
    parser.add_argument(
        "--velocity", type=shell.velocity, metavar="planck|SPEED,L,B", help="km/s, Galactic degrees of the apex: fit H0"
    )
    parser.add_argument(
        "--bins", type=_edges, metavar="N|Z,Z,…", help="spin and acceleration in bins of redshift: edges, or how many"
    )
    parser.add_argument("--lmax", type=shell.count(1), default=1, help="highest degree in the bins (default: 1)")
    parser.add_argument("--common", action="store_true", help="degrees above 1 the same in all bins")
    parser.add_argument(
        "--peculiar", type=shell.not_negative, default=750.0, metavar="SIGMA",
        help="dispersion of peculiar velocities in each component, km/s (default: 750)",
    )  # fmt: skip
    parser.add_argument("--omega-m", type=_fraction, metavar="X", help="flat cosmology (default: 0.315)")
    parser.add_argument(
        "--clip",
        type=shell.positive,
        metavar="KAPPA",
        help="first leave out sources beyond KAPPA medians of a degree-1 fit",
    )
    parser.add_argument("--free-spin", action="store_true", help="fit the spin of the frame as well")
    posterior = parser.add_argument_group("posterior of our velocity and H0")
    posterior.add_argument("--posterior", action="store_true", help="sample it; velocity: Planck's or --velocity")
    posterior.add_argument("--samples", type=shell.count(1), default=400_000, metavar="N", help="default: 400000")
    posterior.add_argument("--checkpoint", metavar="FILE", help="keep the chain here, and go on from it")
    posterior.add_argument("--hubble-error", type=shell.positive, metavar="SIGMA", help="prior H0 ± SIGMA (or flat)")
    posterior.add_argument("--hubble-range", type=_range, metavar="LOW,HIGH", help="a prior flat between limits")
    posterior.add_argument(
        "--free-peculiar", type=shell.positive, metavar="MOST", help="dispersion free, flat from 0 to MOST km/s"
    )
    posterior.add_argument("--seed", type=int, default=1, help="the same seed, the same chain (default: 1)")
    shell.add_reading(parser)
    parser.add_argument("--version", action="version", version=f"vsh-drift {vsh.__version__}")
    return parser


def _edges(text):
    edges = shell.numbers(text)
    if len(edges) == 1:
        shell.count(1)(text)
    elif not all(a < b for a, b in pairwise(edges)):
        raise argparse.ArgumentTypeError(f"edges must rise, not {text!r}")
    return edges


def _range(text):
    limits = shell.numbers(text)
    if len(limits) != 2 or not 0 < limits[0] < limits[1]:
        raise argparse.ArgumentTypeError(f"two rising numbers above zero are wanted, not {text!r}")
    return limits


def _fraction(text):
    number = shell.positive(text)
    if number >= 2:
        raise argparse.ArgumentTypeError(f"Ω_m between 0 and 2 is wanted, not {text!r}")
    return number


if __name__ == "__main__":
    sys.exit(main())
