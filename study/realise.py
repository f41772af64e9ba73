"""One realisation: noise on the truth, and what every estimator makes of it.

Positions, and covariances from every transit of the mission, are shared by all realisations of a case.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

import fit
import sim
from fit.secular_parallax import hubble_constant, observer_velocity
from sim import agis
from study.config import Study, StudyError
from vsh import Field, Modes, Vector
from vsh.models.cosmology import transverse_distance, with_redshift
from vsh.tools.files import read_arrays, write_arrays


def prepare_realisation(
    study: Study,
    case: dict[str, Any],
    kind: Literal["quasars", "vlbi", "galaxies"],
    folder: Path,
    progress: bool = True,
) -> Path:
    """The file with the sources of one kind, made if it is not there."""
    specification = {"kind": kind, "sources": case[kind], "mission": study.mission, "seed": study.settings["seed"]}
    if kind == "galaxies":  # how they are seen is no matter of theirs
        specification["sources"] = {key: value for key, value in case[kind].items() if key != "redshifts"} | {
            "columns": 2
        }
    specification |= {"frame": study.settings["frame"]} | ({"quasars": case["quasars"]} if kind == "vlbi" else {})
    return kept(folder, kind, specification, lambda _: _make(study, case, kind, progress))


def kept(folder: Path, kind: str, wanted: dict[str, Any], make: Callable[[Path], dict[str, Any]]) -> Path:
    """A file of arrays, made if it is not there."""
    key = hashlib.sha256(json.dumps(wanted, sort_keys=True).encode()).hexdigest()[:16]
    path = folder / f"{kind}-{key}.npz"
    if not path.exists():
        arrays = make(path)
        write_arrays(path, arrays)
    return path


def streams_and_law(study: Study) -> tuple[np.random.Generator, np.random.Generator, sim.NominalScanningLaw]:
    """The streams of positions and of chosen sources, the same in all cases, and the scanning law with its gaps."""
    # A stream for each thing, the same in all cases: what differs between them is what they say.
    skies, selection, gaps = np.random.default_rng(study.settings["seed"]).spawn(3)
    mission = study.mission
    return skies, selection, sim.NominalScanningLaw(years=mission["years"], dead_time=mission["dead_time"], rng=gaps)


def galaxies_of(case: dict[str, Any], skies: np.random.Generator) -> sim.Population:
    """The galaxies of a case."""
    galaxies = case["galaxies"]
    limits = {name: galaxies[name] for name in ("min_redshift", "max_redshift")}
    return sim.galaxies(galaxies["number"], skies.spawn(1)[0], galaxies["sky"], **limits)


def _make(study, case, source_type, progress):
    mission = study.mission
    skies, selection, law = streams_and_law(study)
    quasars, options = case["quasars"], {"progress": progress}
    sim_mission = sim.Mission(law, mission["release"], mission["attitude"])
    try:
        if source_type == "galaxies":
            population = galaxies_of(case, skies)
            options["excess_noise"] = case["galaxies"]["excess_noise"]
        else:
            population = sim.quasars(quasars["number"], skies, quasars["sky"])
            if source_type == "vlbi":
                population = sim.vlbi_quasars(population, case["vlbi"]["number"], selection)
            if quasars["variability"]:
                options["variability"] = sim.Variability(quasars["variability"], quasars["tau"])
        parameters: Any = "position" if source_type == "vlbi" else "motion"
        formal, true = sim.expected_covariances(population, sim_mission, parameters, **options)
    except ValueError as error:
        raise StudyError(f"case {case['name']}, {source_type}: {error}") from error
    good = np.isfinite(formal[:, 0, 0])
    population, formal, true = population[good], formal[good], true[good]
    if source_type == "vlbi":
        # The radio positions scatter, and theirs are the errors that are quoted: what the paper's formal
        # errors of ε are (100 µas / √(3300 · 2/3) = 2.1 µas), and why its scatter is half as large again.
        radio = case["vlbi"]["radio"] ** 2 * np.eye(2)
        formal, true = np.broadcast_to(radio, formal.shape), true + radio
    frame = study.settings["frame"]
    formal_field, true_field = (_rotate_errors(population, covariance, frame) for covariance in (formal, true))
    s1, s2 = true_field.sigma
    arrays = {
        "lon": formal_field.lon,
        "lat": formal_field.lat,
        "sigma": formal_field.sigma,
        "rho": formal_field.rho,
        # L of the true covariance, L Lᵀ: noise is L times unit normals.
        "noise": np.stack([s1, true_field.rho * s2, s2 * np.sqrt(1 - true_field.rho**2)]),
    }
    return arrays | (
        {"redshift": population.redshift, "magnitude": population.magnitude} if source_type == "galaxies" else {}
    )


def _rotate_errors(population, covariance, frame):
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    rho = covariance[:, 0, 1] / (sigma[0] * sigma[1])
    field = Field(population.lon, population.lat, np.zeros_like(sigma), sigma, rho, frame=population.frame)
    return field.to_frame(frame)


def prepared_sources(study: Study, case: dict[str, Any], folder: Path, progress: bool = True) -> Path:
    """The file with all sources of a case and the folder with their transits, made if they are not there."""
    specification = {
        "sources": {key: value for key, value in case.items() if key != "name"},
        "mission": study.mission,
        "seed": study.settings["seed"],
    }
    return kept(folder, "joint", specification, lambda path: _make_joint(study, case, path.with_suffix(""), progress))


def _make_joint(study, case, scans, progress):
    """The sources of a case, and the folder of their transits."""
    mission = study.mission
    skies, selection, law = streams_and_law(study)
    sim_mission = sim.Mission(law, mission["release"], "solved", mission["knots"])
    try:
        quasars = sim.quasars(case["quasars"]["number"], skies, case["quasars"]["sky"])
        galaxies, excess = None, 0.0
        if "galaxies" in case:
            galaxies, excess = galaxies_of(case, skies), case["galaxies"]["excess_noise"]
        mixture = agis.mixture(sim_mission, quasars, galaxies, excess_noise=excess)
        vlbi = np.zeros(0, int)
        if "vlbi" in case:
            vlbi = np.sort(selection.choice(len(quasars), case["vlbi"]["number"], replace=False))
        agis.joint_system(
            law,
            mixture.lon,
            mixture.lat,
            mixture.sigma,
            knots=mission["knots"],
            number=len(quasars),
            folder=scans,
            progress=progress,
        )
    except ValueError as error:
        raise StudyError(f"case {case['name']}: {error}") from error
    arrays = {entry.name: getattr(mixture, entry.name) for entry in fields(mixture)}
    return arrays | {"vlbi": vlbi, "gaps": law.lost}


def solved_errors(study: Study, case: dict[str, Any], path: Path, rng: np.random.Generator) -> dict[str, Field]:
    """Solve one draw of all observations: errors of motions and of radio offsets, by kind of source."""
    system, mixture, vlbi = _system(path, json.dumps(study.mission, sort_keys=True))
    noise, radio = rng.spawn(2)
    quasars = case["quasars"]
    variability = sim.Variability(quasars["variability"], quasars["tau"]) if quasars["variability"] else None
    observed = agis.observations(system.scans, noise, variability=variability, variable=mixture.are("quasars"))
    solution = agis.in_own_frame(system, system.solve(*observed, sources=mixture.are("quasars")))
    frame = study.settings["frame"]
    columns = {"redshift": mixture.redshift, "magnitude": mixture.magnitude}
    fields = {"quasars": solution.field(sources=mixture.are("quasars"))}
    if "galaxies" in case:
        fields["galaxies"] = replace(solution.field(sources=mixture.are("galaxies"), **columns), redshift_frame="true")
    if "vlbi" in case:
        offsets = solution.field(sources=vlbi, kind="position")
        sigma = np.full(offsets.sigma.shape, case["vlbi"]["radio"])
        # The radio positions scatter, and theirs are the errors that are quoted, as in `study.prepare`.
        motion = offsets.motion + sigma * radio.standard_normal(sigma.shape)
        fields["vlbi"] = replace(offsets, motion=motion, sigma=sigma, rho=np.zeros(len(offsets)))
    return {source_type: field.to_frame(frame) for source_type, field in fields.items()}


@lru_cache(maxsize=1)
def _system(path, mission):
    """The equations of a prepared file; its transits are mapped into memory."""
    settings = json.loads(mission)
    arrays = read_arrays(path)
    vlbi, gaps = arrays.pop("vlbi"), arrays.pop("gaps")
    mixture = agis.Mixture(**arrays)
    law = sim.NominalScanningLaw(years=settings["years"], gaps=tuple(map(tuple, gaps)))
    system, _ = agis.joint_system(
        law,
        mixture.lon,
        mixture.lat,
        mixture.sigma,
        knots=settings["knots"],
        number=int(mixture.are("quasars").sum()),
        folder=path.with_suffix(""),
        threads=1,
    )
    return system, mixture, vlbi


_KINDS = ("quasars", "vlbi", "galaxies")


def realise(study: Study, index: int, files: dict[str, Path], number: int) -> dict[str, dict[str, float]]:
    """Draw and fit one realisation."""
    truth, frame = study.truth, study.settings["frame"]
    streams = {
        source_type: np.random.default_rng([study.settings["seed"], 7, index, number, k])
        for k, source_type in enumerate(_KINDS)
    }
    fields, signals = {}, {}
    joint = "joint" in files
    if joint:
        stream = np.random.default_rng([study.settings["seed"], 7, index, number, len(_KINDS)])
        fields = solved_errors(study, study.cases[index], files["joint"], stream)
    for source_type in list(fields if joint else files):
        signal = {
            "quasars": lambda: sim.spin(truth["spin"]) + sim.acceleration(truth["acceleration"]),
            "vlbi": lambda: sim.spin(truth["orientation"]),
            "galaxies": lambda: _galaxy_signal(study, index, frame, streams["galaxies"]),
        }[source_type]()
        signals[source_type] = signal
        fields[source_type] = (
            _add_signal(fields[source_type], signal)
            if joint
            else _draw(files[source_type], signal, frame, streams[source_type])
        )
    values: dict[str, float] = {}
    sigma: dict[str, float] = {}

    direct = fit.solve_frame(fields["quasars"], fields.get("vlbi"))
    values |= dict(zip(direct.names, direct.values, strict=True))
    sigma |= dict(zip(direct.names, direct.sigma, strict=True))
    for degree in sorted({1, study.settings["lmax"]}):
        solution = fit.solve(fit.normal_equations(fields["quasars"], Modes(degree), threads=1))
        for name, vector in (("omega", solution.spin), ("a", solution.acceleration)):
            _put_vector(values, sigma, name, vector, f"@{degree}")
    if "galaxies" in fields:
        at = slice(start := direct.names.index("omega_x"), start + 3)
        spin_covariance = direct.covariance[at, at] * study.settings["propagate_spin"]
        spin = Vector(direct.values[at], spin_covariance, frame)
        options = {
            "peculiar_dispersion": study.cases[index]["galaxies"]["peculiar_dispersion"],
            "spin": spin,
            "flows": None,
        }
        estimate = observer_velocity(fields["galaxies"], truth["hubble"], **options)
        _put_vector(values, sigma, "v", estimate.velocity)
        _put_vector(values, sigma, "g_a", estimate.acceleration)
        velocity = true_velocity(study)
        if velocity.amplitude > 0:
            hubble = hubble_constant(fields["galaxies"], velocity, hubble=truth["hubble"], **options)
            values["H0"], sigma["H0"] = hubble.hubble, hubble.hubble_error
        if study.cases[index]["galaxies"]["redshifts"] == "both":
            _as_seen(study, index, fields["galaxies"], signals["galaxies"], options, values, sigma)
    return {
        label: {name: float(x) for name, x in table.items()} for label, table in (("values", values), ("sigma", sigma))
    }


def true_velocity(study: Study) -> Vector:
    """The velocity of the configuration (speed, l, b), a Vector along the study's axes. [km/s]"""
    speed, l, b = study.truth["velocity"]
    return Vector.from_spherical(speed, l, b, frame="galactic", unit="km/s").to_frame(study.settings["frame"])


def _galaxy_signal(study, index, frame, stream):
    truth, galaxies = study.truth, study.cases[index]["galaxies"]
    signal = sim.spin(truth["spin"]) + sim.acceleration(truth["acceleration"])
    velocity = true_velocity(study)
    if velocity.amplitude > 0:
        signal += sim.secular_parallax(velocity.value, hubble=truth["hubble"])
    if galaxies["peculiar_dispersion"]:
        signal += sim.peculiar(galaxies["peculiar_dispersion"], stream.spawn(1)[0], hubble=truth["hubble"])
    return signal


@lru_cache(maxsize=6)
def _arrays(path):
    return read_arrays(path)


def _draw(path, signal, frame, rng):
    arrays = _arrays(path)
    unit = rng.standard_normal(arrays["sigma"].shape)
    l11, l21, l22 = arrays["noise"]
    noise = np.stack([l11 * unit[0], l21 * unit[0] + l22 * unit[1]])
    motion = signal(arrays["lon"], arrays["lat"], arrays.get("redshift")) + noise
    return Field(
        arrays["lon"],
        arrays["lat"],
        motion,
        arrays["sigma"],
        arrays["rho"],
        redshift=arrays.get("redshift"),
        magnitude=arrays.get("magnitude"),
        frame=frame,
        redshift_frame="true",
    )


def _add_signal(errors, signal):
    """True motions with errors that are given."""
    return replace(errors, motion=errors.motion + signal(errors.lon, errors.lat, errors.redshift))


def _as_seen(study, index, galaxies, signal, options, values, sigma):
    """Galaxies with redshifts as the Sun sees them: names end in @seen."""
    truth, sources = study.truth, study.cases[index]["galaxies"]
    redshift = signal.observed_redshift(galaxies.lon, galaxies.lat, galaxies.redshift, "heliocentric")
    catalogue = with_redshift(
        replace(galaxies, redshift=redshift, redshift_frame="heliocentric"), sources["min_redshift"]
    )
    limits = transverse_distance(np.array([sources["min_redshift"], sources["max_redshift"]]))
    options = options | {"density": partial(_clip_distances, lower=limits[0], upper=limits[1])}
    solution = observer_velocity(catalogue, truth["hubble"], **options)
    _put_vector(values, sigma, "v", solution.velocity, "@seen")
    _put_vector(values, sigma, "g_a", solution.acceleration, "@seen")
    velocity = true_velocity(study)
    if velocity.amplitude > 0:
        hubble = hubble_constant(catalogue, velocity, hubble=truth["hubble"], **options)
        values["H0@seen"], sigma["H0@seen"] = hubble.hubble, hubble.hubble_error


def _clip_distances(distance, lower, upper):
    """Galaxies evenly in volume between two distances, as they are drawn."""
    return (distance >= lower) & (distance <= upper)


def _put_vector(values, sigma, name, vector, suffix=""):
    for axis, value, error in zip("xyz", vector.value, vector.sigma, strict=True):
        values[f"{name}_{axis}{suffix}"], sigma[f"{name}_{axis}{suffix}"] = value, error
