"""Options by the names that they had before version 0.2, understood until 0.3: in words and in a saved run.toml."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

#: What is said today for an option, with its value in place of {}; of one command where that stands before it.
#: Names without a rule of their own, `log`, `threads` and `citation`, are settings of the process.
RULES: dict[str, str | Callable[[str], str]] = {
    "dpi {}": "format @{}", "no-figures": "format none", "figures {}": "format {}", "scheduler {}": "workers {}",
    "catalogue-frame {}": "columns frame={}", "input-format {}": "columns format={}", "sigma {}": "columns sigma={}",
    "position-error {}": "columns sigma={}", "vsh-fit years {}": "waves {}", "vsh-compare no-floor": "floor no",
    "vsh-compare by {}": "match {}", "vsh-compare radius {}": "match {}", "vsh-compare threshold {}": "method clip={}",
    "vsh-redshift no-floor": "floor no", "vsh-redshift estimator {}": "method {}",
    "vsh-redshift clip {}": "method clip={}",
    "vsh-redshift method {}": lambda value: f"{'sampler' if value in ('emcee', 'grid') else 'method'} {value}",
    "vsh-redshift n-samples {}": "posterior {}", "vsh-redshift peculiar-dispersion {}": "dispersion {}",
    "vsh-redshift peculiar-dispersion-max {}": "dispersion 0:{}",
    "vsh-redshift h0-range {}": lambda value: f"h0 {value.replace(',', ':')}", "vsh-redshift h0-error {}": "h0 ±{}",
    "vsh-redshift no-flows": "flows no", "vsh-redshift reconstruction {}": "flows {}",
    "vsh-redshift local-group": "flows yes", "vsh-redshift no-local-group": "flows alone",
    "vsh-redshift no-magnitudes": "columns magnitude=", "vsh-sim peculiar-dispersion {}": "flow {}",
    "vsh-sim selection {}": "sky {}", "vsh-sim no-transits": "errors expected",
    "vsh-sim attitude {}": lambda value: f"{'errors' if value == 'solved' else 'attitude'} {value}",
}  # fmt: skip
#: Settings of a process, with values or without.
_SETTINGS = {"log": True, "threads": True, "citation": False}
#: What went, and how to have it: an argument of a function in Python.
GONE = {
    "vsh-fit beside": "fit.write_html(beside=)", "vsh-fit seed": "fit.estimate(rng=)",
    "vsh-compare seed": "fit.frames.compare.compare_catalogues(rng=)",
    "vsh-redshift seed": "fit.posterior.sample(rng=)",
    "vsh-redshift free-spin": "observer_velocity(spin='free')",
    "vsh-redshift omega-m": "observer_velocity(cosmology=)",
    "vsh-redshift acceleration": "observer_velocity(acceleration=)",
    "vsh-redshift n-modes": "observer_velocity(n_modes=)",
    "vsh-redshift flow-amplitude": "fit.posterior.sample(flow_amplitude=)",
    "vsh-redshift reconstruction-error": "observer_velocity(reconstruction_error=)",
    "vsh-redshift shared-higher-degrees": "fit.redshift.binned(shared_higher_degrees=True)",
    "vsh-redshift distances": "fit.kinematics(field)", "vsh-redshift oort": "fit.kinematics(field, gradient=True)",
    "vsh-correlate parameters": "fit.correlation.predict_covariance", "vsh-correlate nside": "influence_map(nside=)",
    "vsh-link prior-magnitude": "fit.frames.link.read_priors(path, magnitude)",
    "vsh-link no-offset": "fit.frames.link.link(excess=False)",
    "vsh-link epochs": "vsh.io.astrometry.read_astrometry(epoch=)",
    "vsh-waves law-nside": "sim.agis.Response", "vsh-archive batch": "vsh.io.archive.fetch_epochs(batch=)",
    "vsh-archive patience": "vsh.io.archive.query(patience=)",
    "vsh-sim map-frame": "sim.quasars(map_frame=)", "vsh-sim binaries": "sim.link(binaries=)",
    "vsh-sim single": "sim.link(single=)", "vsh-sim quasars": "sim.link(quasars=)", "vsh-sim jump": "sim.link(jump=)",
    "vsh-sim redshift-error": "sim.observe(redshift_error=)", "vsh-sim variability": "sim.Variability",
    "vsh-sim tau": "sim.Variability", "vsh-sim attitude": "sim.Mission", "vsh-sim excess-noise": "sim.observe",
    "vsh-sim redshift-range": "sim.galaxies(min_redshift=, max_redshift=)", "vsh-sim units": "sim.Population",
    "vsh-sim h0": "sim.secular_parallax(hubble=)", "vsh-sim table": "sim.crf4(table=)", "vsh-sim years": "sim.Mission",
}  # fmt: skip


def _find_renaming_rule(command, name, has_value):
    """The rule of an option of a command, or None."""
    key = f"{name} {{}}" if has_value else name
    return RULES.get(f"{command} {key}", RULES.get(key))


def renew_words_and_settings(command: str, words: Sequence[str]) -> tuple[list[str], dict[str, Any]]:
    """The words of a command with the names of today, and what they set for the process."""
    kept_words, settings, renewed_words = [], {}, []
    remaining_words = list(words)
    while remaining_words:
        word = remaining_words.pop(0)
        name, equals, value = word.removeprefix("--").partition("=")
        takes_value = _find_renaming_rule(command, name, True) or _SETTINGS.get(name)
        is_known = takes_value or _find_renaming_rule(command, name, False) or name in _SETTINGS
        if not (word.startswith("--") and is_known):
            kept_words.append(word)
            continue
        if takes_value and not equals:
            value = remaining_words.pop(0) if remaining_words else ""
        if name in _SETTINGS:
            settings[name] = value if _SETTINGS[name] else True
        else:
            renewed_words.append(f"--{_renew_option(command, name, value if takes_value else True)}")
    return kept_words + renewed_words, settings


def renew_options(command: str, options: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    """The options of a saved run with the names of today."""
    for name, value in options.items():
        value_text = ",".join(value) if isinstance(value, tuple) else value
        if _find_renaming_rule(command, name, value is not True):
            new_name, _, new_value = _renew_option(command, name, value_text).partition("=")
            yield new_name, new_value
        else:
            yield name, value


def _renew_option(command, name, value):
    """An option as it is said today, NAME=VALUE."""
    rule = _find_renaming_rule(command, name, value is not True)
    renewed_text = rule(value) if callable(rule) else rule.format(value)
    new_name, _, new_value = renewed_text.partition(" ")
    return f"{new_name}={new_value}"
