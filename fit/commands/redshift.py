"""`vsh-redshift`: our velocity, the Hubble constant and dipoles in redshift bins, on the command line."""

import argparse
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import fit
import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Answer, Section
from vsh.tools.digits import format_p_value, format_three_digits, format_with_error
from vsh.tools.errors import ConvergenceError, DegeneracyError, ParameterError, VshError
from vsh.tools.notes import count_dropped, count_unselected, doubts_of, has_code


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-redshift",
        description=(
            "Fit our velocity (of the Solar System in the frame of the microwave background) or the Hubble constant "
            "to proper motions and redshifts: our velocity for a known Hubble "
            "constant, the Hubble constant for a known velocity, the posterior of both, and spin and acceleration in "
            "bins of redshift."
        ),
        examples=(
            "vsh-redshift galaxies.fits --h0 67.4",
            "vsh-redshift galaxies.fits --bins 3 --lmax 5 --floor --output results",
            "vsh-redshift galaxies.fits --posterior 20000 --velocity planck",
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", parsing.A_TABLE)
    add(
        "--h0 H0[±ERROR]|LOW:HIGH",
        "fit our velocity for this Hubble constant, km/s/Mpc | of the posterior, a Gaussian prior where an error is "
        "given, 67.4±1 (or 67.4+-1), and a flat prior between limits, 40:110; flat unless given",
        _parse_hubble_prior,
        action=parsing.JoinValues,
    )
    add(
        "--velocity planck|SPEED,L,B",
        "fit H0 for this velocity | planck, or the speed in km/s and the Galactic longitude and latitude of the apex "
        "in degrees",
        parsing.parse_velocity,
    )
    add("--bins N|Z,Z,…", "fit spin and acceleration in bins of redshift | their number, or their edges", _parse_bins)
    add("--lmax", "highest degree in the bins", parsing.count(1), 1)
    add(
        "--floor",
        "with --bins: include systematic errors in the test whether the dipole changes | estimated from the power of "
        "degrees 2 to --lmax (to degree 5 if --lmax is 1; not with --lmax 2); the default for 100000 sources or more; "
        "with no the report only states their size",
        ("yes", "no"),
        nargs="?",
        const="yes",
    )
    add(
        "--method NAME[=VALUE]",
        "estimator of the bins: recommended (default), least-squares, clip=KAPPA, student or excess-noise | near "
        "galaxies are fitted by least squares alone; clip excludes from everything else, too, sources whose residuals "
        "from a fit of degree 1 exceed KAPPA times the median residual",
        parsing.check_method,
    )
    add(
        "--dispersion SIGMA|free|0:MAX",
        "dispersion of peculiar velocities in each component, km/s (default: 150 with flows, 750 without) | free, and "
        "0:MAX: free in the posterior, with a flat prior up to there",
        _parse_dispersion,
    )
    add(
        "--redshift-frame",
        "frame of the redshifts, if the table does not state it | true: redshifts due to the expansion alone",
        parsing.REDSHIFT_FRAMES,
    )
    add(
        "--flows yes|no|alone|FILE",
        "flows of linear theory are fitted, with the motion of the Local Group (yes, the default), or not | no: for "
        "the real Universe errors are then several times too small; alone: without the Local Group, so that H0 is too "
        "low by about its error where we move with the flow; FILE: the fitted flow describes only the error of a "
        "reconstructed velocity field on a grid (.npz, or .npy in the format of 2M++)",
        _parse_flows,
        nargs="?",
        const="yes",
    )
    add(
        "--posterior N",
        "sample the posterior of H0 and the velocity | by so many samples (100000 unless given); prior on the "
        "velocity: Planck's, or that given by --velocity",
        parsing.count(1),
        nargs="?",
        const=100_000,
    )
    add(
        "--sampler",
        "emcee, a Markov chain (default), or grid, independent samples | grid: possible if at most one parameter is "
        "free besides the velocity and H0",
        ("emcee", "grid"),
    )
    add("--checkpoint FILE", "save the chain in this file; an interrupted run resumes from it")
    reading.add_workers(parser)
    reading.add_reading(parser)
    return parsing.add_common(parser)


def _parse_dispersion(text):
    if text == "free":
        return text
    low, colon, high = text.partition(":")
    if colon and parsing.parse_not_negative(low) != 0:
        raise argparse.ArgumentTypeError(f"a range of dispersions begins at 0, as 0:400, not {text!r}")
    return (0.0, parsing.parse_positive(high)) if colon else parsing.parse_not_negative(text)


def _parse_flows(text):
    if text not in ("yes", "no", "alone") and not text.endswith((".npz", ".npy")):
        raise argparse.ArgumentTypeError(f"yes, no, alone or a grid of velocities (npz, npy) is expected, not {text!r}")
    return text


def _parse_hubble_prior(text):
    """H0, its error and the limits of a prior, those that are given, by name."""
    prior: dict[str, Any] = {}
    for words in text.replace("+-", "±").split(","):
        low, colon, high = words.partition(":")
        value, _, error = words.partition("±")
        if colon:
            prior["limits"] = parsing.parse_positive(low), parsing.parse_positive(high)
            if not prior["limits"][0] < prior["limits"][1]:
                raise argparse.ArgumentTypeError(f"two rising numbers above zero are expected, not {text!r}")
            continue
        prior |= {"value": parsing.parse_positive(value)} if value else {}
        prior |= {"error": parsing.parse_positive(error)} if error or not value else {}
    return prior


def _parse_bins(text):
    numbers = parsing.parse_numbers(text)
    if len(numbers) == 1:
        parsing.count(1)(text)
    elif not all(a < b for a, b in pairwise(numbers)):
        raise argparse.ArgumentTypeError(f"edges must rise, not {text!r}")
    return numbers


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself; prior and flow follow from what --h0 and --flows say."""
    for name in ("checkpoint", "sampler"):
        if getattr(options, name) and not options.posterior:
            parser.error(f"--{name} is for --posterior")
    if options.checkpoint and options.sampler == "grid":
        parser.error("--checkpoint keeps a chain: draws from a grid are made at once")
    is_free = options.dispersion == "free" or isinstance(options.dispersion, tuple)
    if is_free and not options.posterior:
        parser.error("--dispersion free or 0:MAX is a prior: it needs --posterior")
    hubble_prior = options.h0 or {}
    if hubble_prior.keys() & {"error", "limits"} and not options.posterior:
        parser.error("--h0 with an error, or between limits, is a prior: it needs --posterior")
    if "error" in hubble_prior and "value" not in hubble_prior:
        parser.error("--h0 has an error, and no value: as 67.4±1")
    options.h0, options.h0_error, options.h0_range = (hubble_prior.get(name) for name in ("value", "error", "limits"))
    if options.floor == "yes" and options.lmax == 2:
        parser.error("--floor needs --lmax 3 or more: degrees 1 and 2 tell nothing of systematic errors")
    method = parsing.split_method(options.method)[0] if options.method else ""
    for name, is_given in (("floor", options.floor), ("method", method not in ("", "clip"))):
        if is_given and not options.bins:
            parser.error(f"--{name} is for --bins")
    if not (options.h0 or options.velocity or options.bins or options.posterior):
        parser.error("nothing to do: give --h0 H0, --velocity planck, --bins EDGES, --posterior")
    checkpoint_folders = Path(options.checkpoint or ".").resolve().parents
    if options.checkpoint and options.output and Path(options.output).resolve() in checkpoint_folders:
        parser.error("keep the checkpoint outside the folder of results, which is replaced as a whole")
    flows_text = options.flows or "yes"
    options.reconstruction = None if flows_text in ("yes", "no", "alone") else flows_text
    options.flows, options.has_group = flows_text != "no", flows_text not in ("no", "alone")


#: Upper limits of a dispersion that is free in the posterior, beside a flow and without. [km/s]
_MAX_DISPERSION = {True: 400.0, False: 1000.0}
#: The degree that it is looked for to where bins are fitted to degree 1.
_FLOOR_DEGREE = 5
_FIGURE_CAPTIONS = {
    "corner": "Every pair of quantities, with 68 and 95 % contours; dashed: the prior on H0.",
    "trace": "Walkers against steps; grey: left out. R̂ near 1 and a large effective size: the chain has converged.",
    "correlations": "Correlations of the parameters.",
}


def _run(options):
    run = finishing.Run(options)
    source = run.open(options.catalogue)
    truth = vsh.io.catalogue.truth_of(source)
    sky = run.read(source, options.catalogue).to_frame(options.frame)
    facts, counts = _make_redshift_facts_and_counts(sky, source, options)
    velocity = reading.make_observer_velocity(options.velocity) or vsh.models.cosmology.CMB_VELOCITY_PLANCK18
    model_options, failure = _choose_model_options(options), None
    method, method_value = parsing.split_method(options.method) if options.method else (None, None)
    parts = _make_bin_parts(sky, options, model_options, velocity, method, method_value) if options.bins else []
    sky = fit.robust.clip(sky, vsh.Modes(1), float(method_value or 3.0)).sources(sky) if method == "clip" else sky
    if options.h0 or options.velocity or options.posterior:
        field = _select_known_redshifts(sky, options, source.label)
        estimates = _estimate_velocity_and_hubble(field, options, model_options, velocity, truth)
        if options.posterior:
            try:
                parts.append(_sample_posterior_part(field, options, model_options, velocity, truth))
            except ConvergenceError as error:  # every other result is written all the same
                failure = error
        has_posterior = options.posterior and failure is None
        parts += [
            _report_estimate(name, estimate, source.label, truth, has_posterior) for name, estimate in estimates.items()
        ]
        flow = next((estimate.flow for estimate in estimates.values()), None)
        if flow is not None:
            caption = "Flow of the galaxies on shells: away from us (colours) and across (arrows)."
            parts.append(finishing.Part("flow", flow, caption=caption, is_long=True, as_table=True))
    results = {part.name: part.result for part in parts}

    def make_sections(long):
        report = [section for part in parts for section in part.select_sections(long)]
        if failure is not None:
            report.append(Section("Posterior", [("not finished", str(failure))]))
        return [replace(report[0], facts=[*facts, *report[0].facts]), *report[1:]] if report else [Section("", facts)]

    run.finish(
        parts,
        sections=make_sections,
        notes=() if isinstance(sky, vsh.io.parts.Parts) else sky.notes,
        answer=Answer(tuple(_format_answer_lines(results))),
        paths=options.catalogue,
        counts=counts,
        title=f"Motions against redshift: {source.label}",
        captions=_FIGURE_CAPTIONS,
    )
    if failure is not None:
        raise failure


def _make_redshift_facts_and_counts(sky, source, options):
    """The frame of the redshifts, as facts, and the numbers of rows; VshError where there are no redshifts."""
    is_parts = isinstance(sky, vsh.io.parts.Parts)
    counts = {}
    if not is_parts:
        reading.refuse_velocities(sky.notes, source.label)
        n_refused = count_dropped(sky.notes)
        counts = {"rows": len(sky) + n_refused + count_unselected(sky.notes), "rows_read": len(sky)}
    if not (sky.has("redshift") if is_parts else sky.redshift is not None):
        raise VshError(
            f"{source.label} has no column of redshifts, which distances do not replace: name it, --columns "
            "redshift=NAME (of stars and clusters with distances or parallaxes, fit.kinematics needs none). The table "
            f"has {', '.join(source.names)}"
        )
    table_frame = next(iter(sky)).redshift_frame if is_parts else sky.redshift_frame
    frame = options.redshift_frame or table_frame or "not known"
    facts = [
        ("redshifts", frame + ("" if frame in ("true", "not known", "cmb") else ", taken to the microwave background"))
    ]
    if table_frame and options.redshift_frame not in (None, table_frame):
        facts.append(("warning", f"the table says that its redshifts are {table_frame}; --redshift-frame prevails"))
    return facts, counts


def _choose_model_options(options):
    """Assumptions of every estimate about distances and motions, as keyword arguments."""
    model_options = {
        "peculiar_dispersion": options.dispersion if isinstance(options.dispersion, float) else None,
        "redshift_frame": options.redshift_frame,
        "flows": "linear" if options.flows else None,
    }
    if options.reconstruction is not None:
        model_options["reconstruction"] = vsh.models.flows.read_velocity_grid(options.reconstruction)
    return model_options


def _make_bin_parts(sky, options, model, velocity, method, value):
    """Spin and acceleration in bins, and where asked for, or of many sources, with common systematic errors."""
    from fit.redshift import binned

    bin_options = {name: model[name] for name in ("redshift_frame", "peculiar_dispersion")}
    edges = int(options.bins[0]) if len(options.bins) == 1 else options.bins
    bin_up_to: Any = partial(binned, sky, edges=edges, flows=model["flows"], method=method, value=value, **bin_options)
    bins = bin_up_to(options.lmax)
    comparison, p_values = None, None
    if options.floor == "yes" or (bins.counts.sum() >= fit.quality.MANY and options.floor != "no"):
        # Permutations know nothing of the systematic errors.
        comparison, remark = _compare_bins_with_systematics(bin_up_to, bins, options.lmax, options.floor == "yes")
    else:
        p_values = _compute_permutation_p_values(sky, bins, velocity, bin_options)
        remark = _describe_missing_floor(sky, bins)

    def make_sections(long):
        tests: Any
        *report, tests = bins.sections(velocity=velocity, p_values=p_values, long=long)
        tests = replace(tests, remarks=[*tests.remarks, remark] if remark else tests.remarks)
        if comparison is not None:  # the verdict is that with systematic errors
            columns = [name for name in tests.table.colnames if name != "verdict"]
            tests = replace(tests, title="Do the bins differ, if errors are independent?", columns=columns)
        return [*report, tests]

    caption = "Acceleration and spin in bins of redshift; dashed: what our motion past nearby galaxies adds."
    plot_bins = partial(bins.plot, velocity)

    def make_tables():
        table = make_sections(True)[-1].table
        return {"Bins of redshift": bins.to_table()} | ({} if table is None else {"Do the bins differ?": table})

    parts = [finishing.Part("bins", bins, "", caption, sections=make_sections, plot=plot_bins, tables=make_tables)]
    if comparison is not None:
        caption = "Spin and acceleration of the bins, with common systematic errors."
        parts.append(finishing.Part("shared", comparison, "Bins with common systematic errors", caption))
    return parts


def _compare_bins_with_systematics(bin_up_to, bins, lmax, is_asked):
    """The systematic errors, or None; and a remark on the p-values without them."""
    degree = lmax if lmax >= 3 else _FLOOR_DEGREE
    bins = bins if lmax >= 3 else bin_up_to(degree)
    if any(fit.background.has_leakage(normal, degree) for normal in bins.normals):
        with suppress(DegeneracyError):  # a bin of few sources does not bear so many, and a note says what that means
            bins = replace(bins, normals=bin_up_to(degree + fit.background.EXTRA_DEGREES).normals)
    try:
        comparison = bins.shared(range(2, degree + 1))
    except VshError as error:
        if is_asked:
            raise
        return None, f"Errors are without systematic errors, which are not known: {error}"
    return comparison, "These p-values are for independent errors; those with systematic errors follow."


def _describe_missing_floor(sky, bins):
    """The size of what errors of bins leave out, in words."""
    if bins.counts.sum() < fit.quality.FEW or bins.flow_share > fit.redshift.FLOW_MATTERS:
        return ""
    try:
        floor = fit.background.floor(fit.fit_field(sky, _FLOOR_DEGREE))
    except VshError:  # of few sources, or on little of the sky, it is not known
        return ""
    return (
        f"The systematic floor is not in these errors: spin ± {floor.spin_error:.3g}, acceleration ± "
        f"{floor.acceleration_error:.3g} µas/yr from degrees 2 to {_FLOOR_DEGREE} of all sources; --floor includes it."
    )


def _compute_permutation_p_values(field, bins, velocity, bin_options):
    """Permute redshifts for p-values of equal bins; None where there are too many sources, or flows that matter."""
    is_small = isinstance(field, vsh.Field) and len(field) <= 20_000
    if not (bins.modes.lmax == 1 and len(bins) > 1 and is_small and bins.flow_share <= fit.redshift.FLOW_MATTERS):
        return None
    test_velocity = velocity if np.isfinite(bins.mean_inverse_distance).all() else None
    return fit.redshift.permutation_test(field, bins, velocity=test_velocity, **bin_options)


def _select_known_redshifts(sky, options, label):
    """The sources with redshifts; VshError where nobody told their frame."""
    with_redshift, missing_only = vsh.models.cosmology.with_redshift, options.on_bad != "drop"
    select = partial(with_redshift, redshift_frame=options.redshift_frame, missing_only=missing_only)
    field = vsh.io.parts.apply_step(sky, select)
    if fit.secular_parallax.is_redshift_frame_undeclared(field, options.redshift_frame):
        raise VshError(
            f"the frame of the redshifts of {label} is not given: use --redshift-frame heliocentric, cmb, "
            "local-group, or true (of the expansion alone, as simulations have them)"
        )
    return field


def _estimate_velocity_and_hubble(field, options, model, velocity, truth):
    """Our velocity for a known H0, and H0 for a known velocity, by least squares."""
    estimates: dict[str, Any] = {}
    if options.h0:
        estimates["velocity"] = fit.secular_parallax.observer_velocity(field, options.h0, **model)
    if options.velocity:
        estimates["hubble"] = _estimate_with_group(
            partial(fit.secular_parallax.hubble_constant, field, velocity, **model), _pick_group(field, options, truth)
        )
    return estimates


def _estimate_with_group(estimate, local_group):
    """An estimate with the Local Group's motion; by default without it where galaxies are too far for a flow."""
    try:
        return estimate(local_group=local_group)
    except ParameterError:
        if not local_group:
            raise
        return estimate()


def _pick_group(field, options, truth):
    """The Local Group's motion, which tells the flow where we are: of real galaxies, or the true one of simulated."""
    from fit.distances import declared_frame

    if not options.has_group:
        return None
    if truth:
        return truth.get("group", False)  # where the observer does not move with the flow nobody needs it
    return (options.redshift_frame or declared_frame(field)) != "true" or None


def _report_estimate(name, estimate, label, truth, has_posterior):
    """An estimate as a part of the result, below the posterior if there is one."""

    heading = "Our velocity" if name == "velocity" else "The Hubble constant"

    def make_tables():
        table = _add_truth_column(estimate.to_table(), _make_truth_by_name(truth, estimate))
        table.meta["summary"] = _summarise_estimate(estimate)
        return {heading: table}

    return finishing.Part(
        name,
        estimate,
        heading,
        sections=lambda long: estimate.sections(source=label, truth=truth, long=long),
        plot=dict,
        is_long=has_posterior,
        tables=make_tables,
        as_table=True,
    )


def _sample_posterior_part(field, options, model_options, velocity_prior, truth):
    """The posterior of our velocity and H0 as a part of the result."""
    h0_prior: Any = fit.posterior.Normal(options.h0, options.h0_error) if options.h0 and options.h0_error else "flat"
    if options.h0_range:
        h0_prior = fit.posterior.Flat(*options.h0_range)
    local_group = _pick_group(field, options, truth)
    if isinstance(options.dispersion, tuple):
        model_options = model_options | {"peculiar_dispersion": fit.posterior.Flat(*options.dispersion)}
    elif options.dispersion == "free":
        model_options = model_options | {"peculiar_dispersion": fit.posterior.Flat(0.0, _MAX_DISPERSION[options.flows])}
    if not velocity_prior.covariance.any():  # a speed without an error is taken to a thousandth, a direction to 0.001°
        l, b = velocity_prior.direction
        velocity_prior = vsh.Vector.from_spherical(
            velocity_prior.amplitude, l, b, (1e-3 * velocity_prior.amplitude, 1e-3, 1e-3), "galactic", "km/s"
        )
    sample = partial(
        fit.posterior.sample, field, velocity_prior, h0_prior, method=options.sampler or "emcee",
        n_samples=options.posterior, rng=1, checkpoint=options.checkpoint, **model_options,
    )  # fmt: skip
    posterior = _estimate_with_group(sample, local_group)

    truth_by_name = _make_truth_by_name(truth, posterior)

    def sections(long):
        *report, last = posterior.sections(long=long)
        shares = {name: 100 * np.mean(posterior.samples[name] < x) for name, x in truth_by_name.items()}
        text = ", ".join(f"{name} {x:.4g} ({shares[name]:.0f} %)" for name, x in truth_by_name.items())
        remarks = [f"Truth, and the share of the samples below it: {text}"] if text else []
        return [*report, replace(last, remarks=[*last.remarks, *remarks])]

    def write_files(folder, meta):
        vsh.io.tables.write_table(posterior.to_table(), folder / "posterior.ecsv", meta)
        posterior.write(folder / "samples.fits", {"CATALOG": str(meta["catalogue"])})

    def draw_plots():
        return {"corner": posterior.corner(truths=truth_by_name or None), "trace": posterior.trace()}

    def tables():
        return {"Posterior": _add_truth_column(posterior.to_table(), truth_by_name)}

    return finishing.Part("posterior", posterior, sections=sections, plot=draw_plots, tables=tables, files=write_files)


def _make_truth_by_name(truth, result):
    """The truth of a simulated catalogue, by the names of a result; empty where it is not known."""
    if not truth or "velocity" not in truth:
        return {}
    truth_by_name = {"H0": truth["hubble"]}
    for name, letter in (("velocity", "v"), ("acceleration", "a")):
        vector = truth[name].to_frame(result.frame)
        truth_by_name |= {f"{letter}_{axis}": float(value) for axis, value in zip("xyz", vector.value, strict=True)}
    names = result.samples if hasattr(result, "samples") else result.names
    return {name: value for name, value in truth_by_name.items() if name in names}


def _add_truth_column(table, truth_by_name):
    """A table of parameters with the truth of a simulated catalogue, if there is one, beside their errors."""
    if truth_by_name:
        position = table.colnames.index("sigma") + 1
        table.add_column([truth_by_name.get(parameter, np.nan) for parameter in table.columns[0]], position, "truth")
    return table


#: H0 is said to depend on its prior where medians differ by such a factor.
_PRIOR_DEPENDENCE_FACTOR = 1.5
#: The Hubble constants that are published lie between these, by Planck and by distance ladders. [km/s/Mpc]
_PUBLISHED_HUBBLE_RANGE = 67.0, 73.0


def _format_answer_lines(results):
    """The lines to quote: what is doubtful, H0, our velocity, whether the dipole changes, and what errors leave out."""
    notes = dict.fromkeys(note for result in results.values() for note in getattr(result, "notes", ()))
    lines = doubts_of(notes)
    estimates = {name: results[name] for name in ("velocity", "hubble") if name in results}
    factor = max([1.0, *(estimate.quality.factor for estimate in estimates.values())])
    results = results | {
        name: replace(each, covariance=factor**2 * each.covariance) for name, each in estimates.items() if factor > 1
    }
    if "posterior" in results:
        lines += _format_posterior_lines(results["posterior"], factor)
    elif "hubble" in results:
        lines.append(("H0", _format_least_squares_hubble(results["hubble"])))
    if "velocity" in results:
        solution = results["velocity"]
        if doubt := fit.secular_parallax.doubt_speed(solution.velocity):
            lines.insert(0, ("doubt", doubt))
        text = f"{fit.output.words_of(solution.velocity)}, for H0 = {solution.assumed_hubble:g} km/s/Mpc"
        lines.append(("velocity", text))
    if "shared" in results and len(results["shared"]) > 1:
        p = results["shared"].verdict().p_value
        text = "a change" if p < fit.quality.SEEN else "no change"
        lines.append(("dipole", f"{text} with redshift is detected, {_format_p_value(p)}, systematic errors included"))
    elif "bins" in results and len(results["bins"]) > 1:
        text = "a change with redshift is not tested, because systematic errors are not included: add --floor"
        lines.append(("dipole", text))
    from fit.secular_parallax import WITH_LOCAL_GROUP

    lines += [("assumed", str(note)) for note in notes if has_code(note, WITH_LOCAL_GROUP)]
    if factor > 1:
        text = f"errors of velocity and H0 here are {factor:.3g} times those below, as residuals suggest"
        if "posterior" in results:
            text = (
                f"residuals suggest errors {factor:.3g} times as large: the velocity and σ outside have them here, the "
                "posterior's intervals have not"
            )
        lines.append(("scaled", text))
    if any(estimate.flow_covariance is not None for estimate in estimates.values()):
        lines.append(("errors", "do not include flows that galaxies have in common"))
    return lines


def _format_least_squares_hubble(solution):
    """H0 by least squares for a known velocity, and how far it is from published values."""
    value, error = solution.hubble, solution.hubble_error
    if not _is_hubble_determined(solution):
        limit = solution.hubble_limits[1]
        return f"not determined: < {format_three_digits(limit)} km/s/Mpc (95 %), {_compare_limit_with_published(limit)}"
    return f"{format_with_error(value, error)} km/s/Mpc, {_format_hubble_deviation(value, error)}"


def _format_hubble_deviation(value, error):
    """Distance of a Hubble constant from the published ones, in its errors."""
    lower, upper = _PUBLISHED_HUBBLE_RANGE
    distance = max(lower - value, value - upper, 0.0) / error
    place = f"{distance:.1f} σ outside" if distance else "within"
    return f"{place} the published range of 67 to 73"


def _compare_limit_with_published(limit):
    """Say if an upper limit leaves room for the published values."""
    return f"{'consistent with' if limit > _PUBLISHED_HUBBLE_RANGE[0] else 'excludes'} the published 67 to 73"


def _format_posterior_hubble(posterior, factor):
    """H0 by the posterior, with its interval or as a limit; and how it stands to the published values.

    Where residuals suggest errors `factor` times as large its distance is in those, as it is by least squares.
    """
    if posterior.hubble_limits is not None:
        low, high = posterior.hubble_limits
        if high == float("inf"):
            return f"not limited from above; > {format_three_digits(low)} km/s/Mpc (95 %)", "the prior has no end"
        return f"not determined: < {format_three_digits(high)} km/s/Mpc (95 %)", _compare_limit_with_published(high)
    h0 = posterior.summary()["H0"]
    error = (h0.median - h0.low68) if h0.median > _PUBLISHED_HUBBLE_RANGE[1] else (h0.high68 - h0.median)
    median, lower, upper, *_ = posterior.print_summary()["H0"]
    return f"{median} km/s/Mpc ({lower} to {upper}, 68 %)", _format_hubble_deviation(h0.median, factor * error)


def _format_posterior_lines(posterior, factor):
    """H0 and the speed by the posterior, medians with 68 % intervals, and the priors they rest on."""
    summary, summary_texts = posterior.summary(), posterior.print_summary()
    lines = [("H0", "{}, posterior; {}".format(*_format_posterior_hubble(posterior, factor)))]
    speed = summary.get("speed")
    has_speed = speed is not None and speed.high68 - speed.low68 > 0.02 * speed.median  # otherwise it is the prior's
    if posterior.hubble_limits is not None and (has_speed or np.isfinite(posterior.hubble_limits[1])):
        product = [f"{value:.0f}" for value in posterior.product]
        lines.append(("v · H0", f"{product[0]} (km/s)²/Mpc ({product[1]} to {product[2]}, 68 %)"))
    if has_speed:
        median, lower, upper, *_ = summary_texts["speed"]
        lines.append(("speed", f"{median} km/s ({lower} to {upper}, 68 %), posterior"))
    priors = posterior.model.priors.describe_in_words()
    lines.append(("prior", f"H0 {priors['hubble']}; velocity {priors['velocity']}"))
    medians = [quantiles.median for quantiles in posterior.hubble_by_prior.values()]
    if medians and max(medians) > _PRIOR_DEPENDENCE_FACTOR * min(medians):
        upper_limits = [quantiles.below for quantiles in posterior.hubble_by_prior.values()]
        interval = f"{format_three_digits(min(upper_limits))} to {format_three_digits(max(upper_limits))} km/s/Mpc"
        caution = f"the motions determine H0 poorly: its 95 % upper limit ranges over {interval} with other priors"
        lines.append(("caution", caution))
    return lines


def _format_p_value(p_value):
    hint = fit.quality.hint_of(p_value)
    return f"p = {format_p_value(p_value)}{hint and f', {hint}'}"


def _is_hubble_determined(solution):
    """Return whether H0 is a number with an error, rather than a limit."""
    return solution.hubble > 3 * solution.hubble_error


def _summarise_estimate(solution):
    """Summarise a velocity, or H0, in a line."""
    if hasattr(solution, "velocity"):
        phrase = f"for H0 = {solution.assumed_hubble:g} km/s/Mpc"
    else:
        lower, upper = solution.hubble_limits
        limits = f"below {format_three_digits(upper)}" + (f", above {format_three_digits(lower)}" if lower > 0 else "")
        if not _is_hubble_determined(solution):
            limits += " (not determined: the table has the least-squares value)"
        speed = solution.assumed_velocity.amplitude
        phrase = f"for our velocity of {speed:.1f} km/s, H0 in km/s/Mpc with 95 % {limits}"
    return (
        f"{solution.n_sources} sources, {solution.frame} axes, {phrase}, χ²/dof = {solution.quality.reduced:.3f}, "
        f"{'coherent flows in the errors' if solution.flow is not None else 'errors without flows'}"
    )


main, run = running.make_entry(__name__, _run)
