"""The lines to quote of `vsh-redshift`: H0 and our velocity with their priors, and the dipole by redshift."""

from typing import Any

import fit
from vsh.io.tables import printed_p_value, three_digits

#: H0 is said to depend on its prior where medians differ by such a factor.
_BY_PRIOR = 1.5
#: The Hubble constants that are published lie between these, by Planck and by distance ladders. [km/s/Mpc]
_PUBLISHED = 67.0, 73.0


def answer_lines(results: dict[str, Any]) -> list[tuple[str, str]]:
    """The lines to quote: H0, our velocity, whether the dipole changes with redshift, and what errors leave out."""
    lines = []
    if "posterior" in results:
        lines += _of_posterior(results["posterior"])
    elif "hubble" in results:
        lines.append(("H0", _of_hubble(results["hubble"])))
    if "velocity" in results:
        solution = results["velocity"]
        text = f"{fit.output.words_of(solution.velocity)}, for H0 = {solution.assumed_hubble:g} km/s/Mpc"
        lines.append(("velocity", text))
    if "shared" in results and len(results["shared"]) > 1:
        p = results["shared"].verdict().p_value
        text = "a change" if p < fit.quality.SEEN else "no change"
        lines.append(("dipole", f"{text} with redshift is detected, {_p(p)}, systematic errors included"))
    elif "bins" in results and len(results["bins"]) > 1:
        text = "a change with redshift is not tested, because systematic errors are not included: add --floor"
        lines.append(("dipole", text))
    estimates = [results[name] for name in ("velocity", "hubble") if name in results]
    if any(estimate.flow_covariance is not None for estimate in estimates):
        lines.append(("errors", "do not include flows that galaxies have in common"))
    return lines


def _of_hubble(solution):
    """H0 by least squares for a known velocity, and how far it is from published values."""
    value, error = solution.hubble, solution.hubble_error
    if not is_determined(solution):
        limit = solution.hubble_limits[1]
        return f"not determined: < {three_digits(limit)} km/s/Mpc (95 %), {_beside_published(limit)}"
    return f"{value:.3g} ± {error:.2g} km/s/Mpc, {_format_deviation(value, error)}"


def _format_deviation(value, error):
    """Distance of a Hubble constant from the published ones, in its errors."""
    lower, upper = _PUBLISHED
    distance = max(lower - value, value - upper, 0.0) / error
    return (
        f"{distance:.1f} σ outside the published range of 67 to 73"
        if distance
        else "within the published range of 67 to 73"
    )


def _beside_published(limit):
    """Say if an upper limit leaves room for the published values."""
    return f"{'consistent with' if limit > _PUBLISHED[0] else 'excludes'} the published 67 to 73"


def hubble_of(posterior: Any) -> tuple[str, str]:
    """H0 by the posterior, with its interval or as a limit; and how it stands to the published values."""
    if posterior.hubble_limits is not None:
        _, below = posterior.hubble_limits
        return f"not determined: < {three_digits(below)} km/s/Mpc (95 %)", _beside_published(below)
    h0 = posterior.summary()["H0"]
    error = (h0.median - h0.low68) if h0.median > _PUBLISHED[1] else (h0.high68 - h0.median)
    median, lower, upper, *_ = posterior.print_summary()["H0"]
    return f"{median} km/s/Mpc ({lower} to {upper}, 68 %)", _format_deviation(h0.median, error)


def _of_posterior(posterior):
    """H0 and the speed by the posterior, medians with 68 % intervals, and the priors they rest on."""
    rows, texts = posterior.summary(), posterior.print_summary()
    lines = [("H0", "{}, posterior; {}".format(*hubble_of(posterior)))]
    if posterior.hubble_limits is not None:
        product = [f"{value:.0f}" for value in posterior.product]
        lines.append(("v · H0", f"{product[0]} (km/s)²/Mpc ({product[1]} to {product[2]}, 68 %)"))
    v = rows.get("speed")
    if v is not None and v.high68 - v.low68 > 0.02 * v.median:  # otherwise it is the prior's
        median, lower, upper, *_ = texts["speed"]
        lines.append(("speed", f"{median} km/s ({lower} to {upper}, 68 %), posterior"))
    priors = posterior.model.priors.in_words()
    lines.append(("prior", f"H0 {priors['hubble']}; velocity {priors['velocity']}"))
    medians = [quantiles.median for quantiles in posterior.hubble_by_prior.values()]
    if medians and max(medians) > _BY_PRIOR * min(medians):
        limits = [quantiles.below for quantiles in posterior.hubble_by_prior.values()]
        interval = f"{three_digits(min(limits))} to {three_digits(max(limits))} km/s/Mpc"
        caution = f"the motions determine H0 poorly: its 95 % upper limit ranges over {interval} with other priors"
        lines.append(("caution", caution))
    return lines


def _p(p):
    hint = fit.quality.hint_of(p)
    return f"p = {printed_p_value(p)}{hint and f', {hint}'}"


def is_determined(solution: Any) -> bool:
    """Return whether H0 is a number with an error, rather than a limit."""
    return solution.hubble > 3 * solution.hubble_error


def summary_of(solution: Any) -> str:
    """Summarise a velocity, or H0, in a line."""
    if hasattr(solution, "velocity"):
        phrase = f"for H0 = {solution.assumed_hubble:g} km/s/Mpc"
    else:
        lower, upper = solution.hubble_limits
        limits = f"below {three_digits(upper)}" + (f", above {three_digits(lower)}" if lower > 0 else "")
        if not is_determined(solution):
            limits += " (not determined: the table has the least-squares value)"
        ours = solution.assumed_velocity.amplitude
        phrase = f"for our velocity of {ours:.1f} km/s, H0 in km/s/Mpc with 95 % {limits}"
    return (
        f"{solution.n_sources} sources, {solution.frame} axes, {phrase}, χ²/dof = {solution.quality.reduced:.3f}, "
        f"{'coherent flows in the errors' if solution.flow is not None else 'errors without flows'}"
    )


def cards_of(results: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Main results, large: our velocity, H0, and χ² of both."""
    cards = []
    if "velocity" in results:
        solution = results["velocity"]
        v = solution.velocity
        size = f"{three_digits(v.amplitude)} ± {three_digits(v.amplitude_error)} km/s"
        size = size if v.p_value < fit.quality.SEEN else f"< {three_digits(v.amplitude_limit())} km/s (95 %)"
        remark = f"p = {printed_p_value(v.p_value)} for none; for H0 = {solution.assumed_hubble:g} km/s/Mpc"
        cards.append(("Our velocity", size, remark))
    if "hubble" in results and "posterior" not in results:  # one limit on H0, that of the lines to quote
        solution = results["hubble"]
        size = f"{solution.hubble:.3g} ± {solution.hubble_error:.2g} km/s/Mpc"
        size = size if is_determined(solution) else f"< {three_digits(solution.hubble_limits[1])} km/s/Mpc (95 %)"
        cards.append(("The Hubble constant", size, f"least squares {solution.hubble:.3g}"))
    if "posterior" in results:
        cards.append(("H0, posterior", *hubble_of(results["posterior"])))
    for name in ("velocity", "hubble"):
        if name in results:
            quality = results[name].quality
            cards.append(("χ² per degree of freedom", f"{quality.reduced:.3f}", f"{results[name].dof} of them"))
            break
    return cards
