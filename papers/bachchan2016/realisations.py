"""Simulated skies of the paper's four cases, each fitted, and a summary of them: what `make paper` runs first.

    python papers/bachchan2016/realisations.py paper --n-realisations 100

The sources of a case and their errors are made once, in `paper/prepared`. Every realisation is a line of
`paper/realisations.jsonl`, written when it is done, so that a run that was stopped goes on where it was.
"""

import argparse
import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

import fit
import sim
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh import Field, Modes, Vector
from vsh.io import tables
from vsh.models.cosmology import transverse_distance, with_redshift
from vsh.tools.files import read_arrays, write_arrays
from vsh.tools.parallel import process_pool, progress_bar, thread_count

#: Kinds of sources, in the order of their streams of random numbers.
KINDS = ("quasars", "vlbi", "galaxies")
_OF_QUASARS = {"variability": 0.0, "tau": 2.0}
_OF_GALAXIES = {"min_redshift": 0.001, "max_redshift": 0.03}
_OF_TRUTH = {"orientation": [0.0, 0.0, 0.0], "spin": [0.0, 0.0, 0.0]}


#: The paper's four cases.
STUDY = Path(__file__).with_name("study.toml")


def load(path: Path = STUDY) -> dict[str, Any]:
    """The configuration with its defaults."""
    study = tomllib.loads(path.read_text(encoding="utf-8"))
    study["truth"] = _OF_TRUTH | study["truth"]
    for case in study["case"]:
        case["quasars"], case["galaxies"] = _OF_QUASARS | case["quasars"], _OF_GALAXIES | case["galaxies"]
    return study


def prepare(study: Mapping[str, Any], case: Mapping[str, Any], kind: str, folder: Path) -> Path:
    """The file with the sources of one kind, their quoted and their true errors; made if it is not there."""
    about = [study["study"], study["mission"], kind, case[kind], case["quasars"] if kind == "vlbi" else None]
    path = folder / f"{kind}-{hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_arrays(path, _sources(study, case, kind))
    return path


def _sources(study, case, kind):
    # A stream for each thing, the same in all cases: what differs between them is what they say.
    skies, selection, gaps = np.random.default_rng(study["study"]["seed"]).spawn(3)
    settings, quasars, galaxies = study["mission"], case["quasars"], case["galaxies"]
    law = sim.NominalScanningLaw(years=settings["years"], dead_time=settings["dead_time"], rng=gaps)
    options = {}
    if kind == "galaxies":
        limits = {name: galaxies[name] for name in _OF_GALAXIES}
        population = sim.galaxies(galaxies["number"], skies.spawn(1)[0], galaxies["sky"], **limits)
        options["excess_noise"] = galaxies["excess_noise"]
    else:
        population = sim.quasars(quasars["number"], skies, quasars["sky"])
        if kind == "vlbi":
            population = sim.vlbi_quasars(population, case["vlbi"]["number"], selection)
        if quasars["variability"]:
            options["variability"] = sim.Variability(quasars["variability"], quasars["tau"])
    mission = sim.Mission(law, settings["release"], settings["attitude"])
    quantity = "position" if kind == "vlbi" else "motion"
    formal, true = sim.expected_covariances(population, mission, quantity, progress=False, **options)
    is_seen = np.isfinite(formal[:, 0, 0])
    population, formal, true = population[is_seen], formal[is_seen], true[is_seen]
    if kind == "vlbi":
        # The radio positions scatter, and theirs are the errors that are quoted: what the paper's formal errors of ε
        # are (100 µas / √(3300 · 2/3) = 2.1 µas), and why its scatter is half as large again.
        radio = case["vlbi"]["radio"] ** 2 * np.eye(2)
        formal, true = np.broadcast_to(radio, formal.shape), true + radio
    quoted, own = (_with_errors(population, each, study["study"]["frame"]) for each in (formal, true))
    arrays = {name: getattr(quoted, name) for name in ("lon", "lat", "sigma", "rho")}
    # L of the true covariance, L Lᵀ: noise is L times unit normals.
    arrays["noise"] = np.stack([own.sigma[0], own.rho * own.sigma[1], own.sigma[1] * np.sqrt(1 - own.rho**2)])
    more = ("redshift", "magnitude") if kind == "galaxies" else ()
    return arrays | {name: getattr(population, name) for name in more}


def _with_errors(population, covariance, frame):
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    rho = covariance[:, 0, 1] / (sigma[0] * sigma[1])
    return Field(population.lon, population.lat, 0 * sigma, sigma, rho, frame=population.frame).to_frame(frame)


_arrays = lru_cache(maxsize=6)(read_arrays)


def _draw(path, signal, frame, rng):
    """One sky: the signal and noise of the true errors."""
    arrays = dict(_arrays(path))
    unit = rng.standard_normal(arrays["sigma"].shape)
    l11, l21, l22 = arrays.pop("noise")
    noise = np.stack([l11 * unit[0], l21 * unit[0] + l22 * unit[1]])
    motion = signal(arrays["lon"], arrays["lat"], arrays.get("redshift")) + noise
    return Field(motion=motion, frame=frame, redshift_frame="true", **arrays)


def true_velocity(study: Mapping[str, Any]) -> Vector:
    """The velocity of the configuration (speed, l, b), a Vector along the study's axes. [km/s]"""
    speed, l, b = study["truth"]["velocity"]
    return Vector.from_spherical(speed, l, b, frame="galactic", unit="km/s").to_frame(study["study"]["frame"])


def realise(study: Mapping[str, Any], index: int, number: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Draw and fit one realisation of a case: value and error of every parameter, by name."""
    settings, truth, case = study["study"], study["truth"], study["case"][index]
    frame, hubble, velocity = settings["frame"], truth["hubble"], true_velocity(study)
    dispersion = case["galaxies"]["peculiar_dispersion"]
    streams = [np.random.default_rng([settings["seed"], 7, index, number, k]) for k in range(len(KINDS))]
    common = sim.spin(truth["spin"]) + sim.acceleration(truth["acceleration"])
    moving = common + sim.secular_parallax(velocity.value, hubble=hubble)
    moving += sim.peculiar(dispersion, streams[2].spawn(1)[0], hubble=hubble)
    signals = (common, sim.spin(truth["orientation"]), moving)
    quasars, vlbi, galaxies = (
        _draw(prepare(study, case, kind, folder), signal, frame, stream)
        for kind, signal, stream in zip(KINDS, signals, streams, strict=True)
    )
    direct = fit.solve_frame(quasars, vlbi)
    found = dict(zip(direct.names, zip(direct.values, direct.sigma, strict=True), strict=True))
    for degree in sorted({1, settings["lmax"]}):
        solution = fit.solve(fit.normal_equations(quasars, Modes(degree), threads=1))
        found |= _by_axis("omega", solution.spin, f"@{degree}") | _by_axis("a", solution.acceleration, f"@{degree}")
    at = slice(start := direct.names.index("omega_x"), start + 3)
    spin = Vector(direct.values[at], direct.covariance[at, at] * settings["propagate_spin"], frame)
    # Redshifts as the expansion makes them, and as the Sun sees them: names of the latter end in @seen.
    seen = moving.observed_redshift(galaxies.lon, galaxies.lat, galaxies.redshift, "heliocentric")
    nearest, farthest = case["galaxies"]["min_redshift"], case["galaxies"]["max_redshift"]
    as_seen = with_redshift(replace(galaxies, redshift=seen, redshift_frame="heliocentric"), nearest)
    lower, upper = transverse_distance(np.array([nearest, farthest]))
    for suffix, field, density in (
        ("", galaxies, {}),
        ("@seen", as_seen, {"density": partial(_is_between, lower, upper)}),
    ):
        options = {"peculiar_dispersion": dispersion, "spin": spin, "flows": None} | density
        ours = observer_velocity(field, hubble, **options)
        found |= _by_axis("v", ours.velocity, suffix) | _by_axis("g_a", ours.acceleration, suffix)
        rate = hubble_constant(field, velocity, hubble=hubble, **options)
        found[f"H0{suffix}"] = rate.hubble, rate.hubble_error
    return {name: (float(value), float(error)) for name, (value, error) in found.items()}


def _by_axis(name, vector, suffix):
    """Value and error of each component of a vector, by name."""
    return {f"{name}_{axis}{suffix}": pair for axis, *pair in zip("xyz", vector.value, vector.sigma, strict=True)}


def _is_between(lower, upper, distance):
    """Galaxies evenly in volume between two distances, as they are drawn."""
    return (distance >= lower) & (distance <= upper)


def _row(study, index, number, folder):
    with threadpool_limits(1):
        found = realise(study, index, number, folder)
    return {"case": study["case"][index]["name"], "number": number, "found": found}


def run(study: Mapping[str, Any], folder: Path, count: int, workers: int | None = None, progress: bool = True) -> None:
    """Make the realisations of all cases that are not in the folder yet, on all cores."""
    path = folder / "realisations.jsonl"
    folder.mkdir(parents=True, exist_ok=True)
    whole = (
        [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")] if path.exists() else []
    )
    done = {(row["case"], row["number"]) for row in map(json.loads, whole)}
    names = [case["name"] for case in study["case"]]
    tasks = [(i, n) for n in range(count) for i, name in enumerate(names) if (name, n) not in done]
    for index in {index for index, _ in tasks}:
        for kind in KINDS:  # before the processes, which share the files
            prepare(study, study["case"][index], kind, folder / "prepared")
    with path.open("w", encoding="utf-8") as output, process_pool(workers or thread_count()) as pool:
        output.writelines(whole)  # without the line that a killed run was writing
        work = pool.map(partial(_row_of, study, folder / "prepared"), tasks)
        for row in progress_bar(work, len(tasks), "realisations", progress):
            print(json.dumps(row), file=output, flush=True)


def _row_of(study, folder, task):
    return _row(study, *task, folder)


def read_realisations(study: Mapping[str, Any], folder: Path, count: int) -> dict[str, tuple[dict, dict]]:
    """Values and errors of the realisations, by case: dicts of name to (count,) arrays."""
    with (folder / "realisations.jsonl").open(encoding="utf-8") as file:
        rows = sorted(map(json.loads, file), key=lambda row: row["number"])
    realisations = {}
    for case in study["case"]:
        found = [row["found"] for row in rows if row["case"] == case["name"] and row["number"] < count]
        if len(found) < count:
            raise SystemExit(f"{folder} has {len(found)} realisations of case {case['name']}, not {count}")
        values, sigma = ({name: np.array([each[name][k] for each in found]) for name in found[0]} for k in range(2))
        realisations[case["name"]] = values, sigma
    return realisations


def summary(study: Mapping[str, Any], realisations: Mapping[str, tuple[dict, dict]]) -> list[dict[str, Any]]:
    """A row for each case and parameter: truth, mean, scatter, formal error, and how many intervals hold the truth."""
    rows = []
    for case, (values, sigma) in realisations.items():
        for name, value in values.items():
            true, n, mean = truth_of(study, name), len(value), float(value.mean())
            std = float(np.std(value, ddof=1)) if n > 1 else float("nan")
            row = {
                "case": case, "parameter": name, "n": n, "truth": true, "mean": mean, "std": std,
                "sigma": float(sigma[name].mean()), "std_error": std / np.sqrt(2 * max(1, n - 1)),
                "off": (mean - true) / (std / np.sqrt(n)) if std > 0 else float("nan"),
            }  # fmt: skip
            for share, reach in ((68, 1.0), (95, 1.959963984540054)):
                chance = float(2 * ndtr(reach) - 1)
                row[f"within_{share}"] = float((np.abs(value - true) <= reach * sigma[name]).mean())
                row[f"within_{share}_error"] = float(np.sqrt(chance * (1 - chance) / n))
            rows.append(row)
    return rows


def truth_of(study: Mapping[str, Any], name: str) -> float:
    """The true value of a parameter."""
    vector, _, axis = name.split("@")[0].removeprefix("g_").rpartition("_")
    if not vector:
        return float(study["truth"]["hubble"])
    key = {"epsilon": "orientation", "omega": "spin", "a": "acceleration"}.get(vector)
    values = study["truth"][key] if key else true_velocity(study).value
    return float(values["xyz".index(axis)])


def main() -> None:
    """Make the realisations, and write summary.ecsv."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--n-realisations", type=int, help="of each case; those of study.toml unless given")
    parser.add_argument("--workers", type=int, help="processes; one a core unless given")
    options = parser.parse_args()
    study = load()
    count = options.n_realisations or study["study"]["n_realisations"]
    run(study, options.folder, count, options.workers)
    rows = summary(study, read_realisations(study, options.folder, count))
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    tables.write_columns(options.folder / "summary.ecsv", columns, {"n_realisations": count}, overwrite=True)


if __name__ == "__main__":
    main()
