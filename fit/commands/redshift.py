"""`vsh-redshift`: our velocity, the Hubble constant and dipoles in redshift bins, on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

import vsh
from vsh.checks.notes import dropped
from vsh.commands import outputs, parsing, parts_options, running
from vsh.cosmology import PLANCK_2018
from vsh.errors import ConvergenceError, VshError
from vsh.parts import Parts
from vsh.vector import Vector


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `vsh-redshift`; returns the exit status: 0, 1 (bad data) or 2 (bad usage).

    Parameters
    ----------
    arguments : list of str, optional
        In place of those of the command line.
    """
    parser = make_parser()
    options = parsing.parse(parser, arguments)
    if options.checkpoint and not options.posterior:
        parser.error("--checkpoint is for --posterior")
    if not (options.h0 or options.velocity or options.bins or options.posterior):
        parser.error("say what is wanted: --h0 H0, --velocity planck, --bins EDGES, --posterior")
    if (
        options.checkpoint
        and options.output
        and Path(options.output).resolve() in Path(options.checkpoint).resolve().parents
    ):
        parser.error("keep the checkpoint outside the folder of results, which is replaced as a whole")
    return running.guarded("vsh-redshift", lambda: _run(options), options.threads)


def _run(options):
    if options.output:
        outputs.check_folder(options.output, "vsh-redshift", options.overwrite)
    # Not before: --help should not wait for astropy and emcee.
    from fit.secular_parallax import hubble_constant, observer_velocity
    from vsh import catalogue, tables
    from vsh.cosmology import with_redshift

    source = tables.open_table(options.catalogue)
    if parts_options.in_parts(options):
        whole = catalogue.parts(options.catalogue, **parts_options.reading_parts(options))
        known = whole.has("redshift")
    else:
        whole = catalogue.read_field(source, **parsing.reading(options))
        known = whole.redshift is not None
    whole = whole.to_frame(options.frame)
    if not known:
        raise VshError(
            f"{options.catalogue} has no column of redshifts: name it, --columns redshift=NAME. "
            f"The table has {', '.join(source.names)}"
        )
    counts = {}
    if not isinstance(whole, Parts):
        refused = dropped(whole.notes)
        counts = {"rows": len(whole) + refused, "rows_read": len(whole)}
    if options.clip:
        whole = _clipped(whole, options.clip)
    cosmology = _cosmology(options)
    results, texts, truth = {}, [], catalogue.truth_of(source)
    if options.bins:
        results["bins"] = _binned(whole, options)
        texts.append(results["bins"].report(p_values=_p_values(whole, results["bins"])))
    common = {
        "cosmology": cosmology,
        "peculiar_dispersion": options.peculiar_dispersion,
        "spin": "free" if options.free_spin else None,
    }
    if options.h0 or options.velocity or options.posterior:
        field = whole
        if options.on_bad == "drop":
            field = whole.map(with_redshift) if isinstance(whole, Parts) else with_redshift(whole)
    if options.h0:
        results["velocity"] = observer_velocity(field, options.h0, **common)
        texts.append(results["velocity"].report(source=options.catalogue, truth=truth))
    if options.velocity:
        results["hubble"] = hubble_constant(field, options.velocity, **common)
        texts.append(results["hubble"].report(source=options.catalogue, truth=truth))
    for text in texts:
        running.say(text)
    unfinished = None
    if options.posterior:
        try:
            found = _posterior(field, options, common)
            texts.append(found.report() + "\n")
            results["posterior"] = found
        except ConvergenceError as error:  # what else was found is written all the same
            unfinished = error
            texts.append(f"posterior: {error}\n")
        running.say(texts[-1])
    if options.output:
        meta = running.provenance(options.catalogue, options, {"vsh-astrometry": vsh.__version__}, **counts)
        with outputs.results_folder(options.output, "vsh-redshift", meta, options.overwrite) as folder:
            _write(results, "\n".join(texts), folder, meta)
            listed = [x.name for x in folder.iterdir()]
        running.say(running.written(options.output, listed))
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
    return binned(
        field, options.lmax, edges, shared_higher_degrees=options.shared_higher_degrees, threads=options.threads
    )


def _clipped(field, kappa):
    """The sources that agree with a fit of degree 1."""
    from fit.robust import clip

    return clip(field, vsh.Modes(1), kappa).sources(field)


def _p_values(field, bins):
    """By permuting redshifts, for up to so many sources."""
    from fit.redshift import permutation_test

    few = isinstance(field, vsh.Field) and len(field) <= 20_000
    wanted = bins.modes.lmax == 1 and len(bins) > 1 and few
    known = PLANCK_2018 if np.isfinite(bins.mean_inverse_distance).all() else None
    return permutation_test(field, bins, velocity=known) if wanted else None


def _posterior(field, options, common):
    from fit.posterior import Flat, Normal, sample

    hubble = Normal(options.h0, options.h0_error) if options.h0 and options.h0_error else "flat"
    if options.h0_range:
        hubble = Flat(*options.h0_range)
    if options.peculiar_dispersion_max:
        common = common | {"peculiar_dispersion": Flat(0.0, options.peculiar_dispersion_max)}
    prior = options.velocity or PLANCK_2018
    if not prior.covariance.any():  # a speed without an error is taken to a thousandth, a direction to 0.001°
        l, b = prior.direction
        prior = Vector.from_spherical(prior.amplitude, l, b, (1e-3 * prior.amplitude, 1e-3, 1e-3), "galactic", "km/s")
    return sample(
        field, prior, hubble, n_samples=options.n_samples, rng=options.seed, checkpoint=options.checkpoint,
        threads=options.threads, **common,
    )  # fmt: skip


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
            tables.write_table(results[name].to_table(), folder / f"{name}.ecsv", meta)
    if "posterior" in results:
        tables.write_table(results["posterior"].to_table(), folder / "posterior.ecsv", meta)
        results["posterior"].write(folder / "samples.fits", {"CATALOG": str(meta["catalogue"])})
        figures |= {"corner": results["posterior"].corner, "trace": results["posterior"].trace}
    save_figures({name: draw() for name, draw in figures.items()}, folder)


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = argparse.ArgumentParser(
        prog="vsh-redshift",
        description="Our velocity for a known Hubble constant, the Hubble constant for a known velocity, the posterior of "
        "both, and spin and acceleration in bins of redshift, from a catalogue of proper motions and redshifts.",
        epilog="Example: vsh-redshift galaxies.fits --h0 67.4 --velocity planck --bins 0.001,0.01,0.03 --output results",
    )
    parser.add_argument("catalogue", help="FITS, VOTable, ECSV, CSV or Parquet file, or a folder of them")
    parser.add_argument("--h0", type=parsing.positive, metavar="H0", help="km/s/Mpc: fit our velocity")
    parser.add_argument(
        "--velocity",
        type=parsing.velocity,
        metavar="planck|SPEED,L,B",
        help="km/s, Galactic degrees of the apex: fit H0",
    )
    parser.add_argument(
        "--bins", type=_edges, metavar="N|Z,Z,…", help="spin and acceleration in bins of redshift: edges, or how many"
    )
    parser.add_argument("--lmax", type=parsing.count(1), default=1, help="highest degree in the bins (default: 1)")
    parser.add_argument("--shared-higher-degrees", action="store_true", help="degrees above 1 the same in all bins")
    parser.add_argument(
        "--peculiar-dispersion", type=parsing.not_negative, default=750.0, metavar="SIGMA",
        help="dispersion of peculiar velocities in each component, km/s (default: 750)",
    )  # fmt: skip
    parser.add_argument("--omega-m", type=_fraction, metavar="X", help="flat cosmology (default: 0.315)")
    parser.add_argument(
        "--clip",
        type=parsing.positive,
        metavar="KAPPA",
        help="first leave out sources beyond KAPPA medians of a degree-1 fit",
    )
    parser.add_argument("--free-spin", action="store_true", help="fit the spin of the frame as well")
    posterior = parser.add_argument_group("posterior of our velocity and H0")
    posterior.add_argument(
        "--posterior",
        action="store_true",
        help="sample it; prior on the velocity: Planck's or --velocity; on H0: flat, or by --h0-error or --h0-range",
    )
    posterior.add_argument("--n-samples", type=parsing.count(1), default=400_000, metavar="N", help="default: 400000")
    posterior.add_argument(
        "--checkpoint", metavar="FILE", help="keep the chain here; an interrupted run resumes from it"
    )
    posterior.add_argument("--h0-error", type=parsing.positive, metavar="SIGMA", help="prior H0 ± SIGMA (or flat)")
    posterior.add_argument("--h0-range", type=_range, metavar="LOW,HIGH", help="a prior flat between limits")
    posterior.add_argument(
        "--peculiar-dispersion-max",
        type=parsing.positive,
        metavar="MAX",
        help="dispersion free, flat from 0 to MAX km/s",
    )
    posterior.add_argument("--seed", type=int, default=1, help="the same seed, the same chain (default: 1)")
    parsing.add_threads(parser)
    parts_options.add_workers(parser)
    parsing.add_reading(parser)
    parser.add_argument("--version", action="version", version=f"vsh-redshift {vsh.__version__}")
    return parser


def _edges(text):
    edges = parsing.numbers(text)
    if len(edges) == 1:
        parsing.count(1)(text)
    elif not all(a < b for a, b in pairwise(edges)):
        raise argparse.ArgumentTypeError(f"edges must rise, not {text!r}")
    return edges


def _range(text):
    limits = parsing.numbers(text)
    if len(limits) != 2 or not 0 < limits[0] < limits[1]:
        raise argparse.ArgumentTypeError(f"two rising numbers above zero are wanted, not {text!r}")
    return limits


def _fraction(text):
    number = parsing.positive(text)
    if number >= 2:
        raise argparse.ArgumentTypeError(f"Ω_m between 0 and 2 is wanted, not {text!r}")
    return number


if __name__ == "__main__":
    sys.exit(main())
