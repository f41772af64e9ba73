"""What a study is: a TOML file, checked, with every default spelled out."""

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.astrometry import RELEASES
from vsh.commands.parsing import SKIES
from vsh.models.cosmology import VELOCITIES, velocity_from_apex
from vsh.sky.frames import FRAMES
from vsh.tools.errors import ParameterError, VshError
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import printable
from vsh.tools.types import PathName


class StudyError(VshError, ValueError):
    """A configuration that makes no study, or a folder that belongs to another."""


#: Sections with their keys and defaults; None must be given.
_SECTIONS = {
    "study": {"name": None, "seed": 1, "n_realisations": 100, "frame": "galactic", "lmax": 3, "propagate_spin": True},
    "mission": {"years": 5.0, "dead_time": 0.06, "release": "DR4", "attitude": 10.0, "knots": 30.0},
    "truth": {
        "orientation": [0.0, 0.0, 0.0],
        "spin": [0.0, 0.0, 0.0],
        "acceleration": [0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0, 0.0],
        "hubble": 67.3,
    },
}
_SOURCES = {
    "quasars": {"number": None, "sky": "uniform", "variability": 0.0, "tau": 2.0},
    "vlbi": {"number": None, "radio": 100.0},
    "galaxies": {
        "number": None,
        "sky": "uniform",
        "excess_noise": 0.0,
        "peculiar_dispersion": 0.0,
        "min_redshift": 0.001,
        "max_redshift": 0.03,
        "redshifts": "true",
    },
}
_TYPES = {int: "a whole number", float: "a number", str: "a string"}


@dataclass(frozen=True)
class Study(InNotebook):
    """A checked configuration.

    Attributes
    ----------
    settings, mission, truth : dicts
        Sections of the file with their defaults.
    cases : list of dicts
        Each with `name`, `quasars`, and perhaps `vlbi` and `galaxies`.
    """

    settings: dict
    mission: dict
    truth: dict
    cases: list

    @property
    def n_realisations(self) -> int:
        """Number of simulated skies of each case."""
        return self.settings["n_realisations"]

    def plain(self) -> dict[str, Any]:
        """The settings that determine each realisation, as values of JSON; their number is not among them."""
        study = {key: value for key, value in self.settings.items() if key != "n_realisations"}
        return json.loads(
            json.dumps({"study": study, "mission": self.mission, "truth": self.truth, "case": self.cases})
        )


def load(source: PathName | dict[str, Any]) -> Study:
    """Read and check a configuration.

    Parameters
    ----------
    source : path of a TOML file, or a dict
        The configuration, as a file or as its content.

    Raises
    ------
    StudyError
        If the file cannot be read, or a key is unknown, missing or of the wrong type; the message names it.
    """
    if not isinstance(source, dict):
        try:
            source = tomllib.loads(Path(source).read_text(encoding="utf-8"))
        except OSError as error:
            raise StudyError(f"{printable(source)} cannot be read: {error.strerror}") from error
        except (ValueError, RecursionError) as error:  # of TOML, of UTF-8, of integers without end
            raise StudyError(f"{printable(source)} is not TOML: {error}") from error
    extras = set(source) - {*_SECTIONS, "case"}
    if extras:
        raise StudyError(f"unknown sections {', '.join(sorted(extras))}; known sections: {', '.join(_SECTIONS)}, case")
    sections = {name: _section(name, source.get(name, {}), keys) for name, keys in _SECTIONS.items()}
    cases = source.get("case", [])
    if not isinstance(cases, list) or not all(isinstance(case, dict) for case in cases):
        raise StudyError("cases must be tables [[case]], in double brackets")
    if not cases:
        raise StudyError("a study needs at least one [[case]]")
    case_settings = [_case(case) for case in cases]
    names = [case["name"] for case in case_settings]
    if len(set(names)) < len(names):
        raise StudyError(f"names of cases must differ: {', '.join(names)}")
    _check(sections)
    return Study(sections["study"], sections["mission"], sections["truth"], case_settings)


def _case(case):
    name = case.get("name")
    if not isinstance(name, str) or not name.isalnum():
        raise StudyError(f"every [[case]] needs a name of letters and digits, not {name!r}")
    extras = set(case) - {"name", *_SOURCES}
    if extras:
        raise StudyError(f"case {name}: unknown {', '.join(sorted(extras))}; known: {', '.join(_SOURCES)}")
    if "quasars" not in case:
        raise StudyError(f"case {name}: [case.quasars] with a number is required")
    settings = {"name": name} | {
        section: _section(f"case {name}, {section}", case[section], _SOURCES[section])
        for section in _SOURCES
        if section in case
    }
    redshifts = settings.get("galaxies", {}).get("redshifts", "true")
    if redshifts not in ("true", "both"):
        raise StudyError(
            f'case {name}, galaxies: redshifts must be "true", or "both" (observed ones, too), not {redshifts!r}'
        )
    for section, values in settings.items():
        if section != "name":
            _check_sources(f"case {name}, {section}", values)
    return settings


def _check_sources(label, values):
    """Numbers that would fail much later, or never."""
    for key, least in (
        ("number", 1),
        ("variability", 0),
        ("tau", 1e-9),
        ("excess_noise", 0),
        ("peculiar_dispersion", 0),
    ):
        if not values.get(key, least) >= least:
            raise StudyError(f"{label}: {key} must be at least {least:g}, not {values[key]}")
    if values.get("sky", "uniform") not in SKIES:
        raise StudyError(f"{label}: sky must be one of {', '.join(SKIES)}, not {values['sky']!r}")
    if not values.get("min_redshift", 0) < values.get("max_redshift", 1):
        raise StudyError(f"{label}: max_redshift must exceed min_redshift")


def _section(name, values, keys):
    if not isinstance(values, dict):
        raise StudyError(f"{name} is a section, [{name}], not {values!r}")
    extras = set(values) - set(keys)
    if extras:
        raise StudyError(f"{name}: unknown key {', '.join(sorted(extras))}; known: {', '.join(keys)}")
    missing = [key for key, default in keys.items() if default is None and key not in values]
    if missing:
        raise StudyError(f"{name}: {', '.join(missing)} must be given")
    section = {key: values.get(key, default) for key, default in keys.items()}
    for key, value in tuple(section.items()):
        default = keys[key]
        if isinstance(default, bool):
            if not isinstance(value, bool):
                raise StudyError(f"{name}: {key} must be true or false, not {value!r}")
            continue
        expected_type = (
            int if key == "number" or isinstance(default, int) else type(default) if default is not None else str
        )
        if key == "velocity":
            section[key] = _velocity(value)
            continue
        if key == "attitude" and isinstance(value, str):
            if value != "solved":
                raise StudyError(f'{name}: attitude is its error in µas, or "solved" with the sources, not {value!r}')
            continue
        if expected_type is float and isinstance(value, int) and not isinstance(value, bool):
            section[key] = value = float(value)
        if expected_type is float and isinstance(value, float) and not np.isfinite(value):
            raise StudyError(f"{name}: {key} is a finite number, not {value!r}")
        if expected_type is list:
            section[key] = _three(name, key, value)
        elif not isinstance(value, expected_type) or isinstance(value, bool):
            raise StudyError(f"{name}: {key} must be {_TYPES[expected_type]}, not {value!r}")
    return section


def _three(name, key, value):
    numbers = isinstance(value, list) and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in value)
    try:
        components = [float(x) for x in value] if numbers else []
    except OverflowError:
        components = []
    if len(components) != 3 or not np.isfinite(components).all():
        raise StudyError(f"{name}: {key} is three finite numbers, not {value!r}")
    return components


def _velocity(value):
    """A name, or SPEED, L, B; no velocity is a speed of zero."""
    if isinstance(value, str) and value in VELOCITIES:
        velocity = VELOCITIES[value]
        return [velocity.amplitude, *velocity.to_frame("galactic").direction]
    components = _three("truth", f"velocity ({' or '.join(map(repr, VELOCITIES))}, or speed, l, b)", value)
    if components[0] != 0:
        try:
            velocity_from_apex(*components)
        except ParameterError as error:
            raise StudyError(f"truth: {error}") from None
    return components


def _check(sections):
    if sections["mission"]["years"] > 100 or sections["mission"]["dead_time"] >= 1:
        raise StudyError("mission: years are at most 100, and dead_time is a fraction below 1")
    if sections["mission"]["release"] not in RELEASES:
        raise StudyError(
            f"mission: release must be one of {', '.join(RELEASES)}, not {sections['mission']['release']!r}"
        )
    if sections["study"]["frame"] not in FRAMES:
        raise StudyError(f"study: frame is one of {', '.join(FRAMES)}, not {sections['study']['frame']!r}")
    for section, key, least in (
        ("study", "seed", 0),
        ("study", "n_realisations", 1),
        ("study", "lmax", 1),
        ("truth", "hubble", 1e-9),
        ("mission", "years", 1e-9),
        ("mission", "dead_time", 0),
        ("mission", "attitude", 0),
        ("mission", "knots", 1e-9),
    ):
        if sections[section][key] != "solved" and not sections[section][key] >= least:
            raise StudyError(f"{section}: {key} must be at least {least:g}, not {sections[section][key]}")
