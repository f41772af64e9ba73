"""What all realisations of a case share: positions, and covariances from every transit of the mission."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np

import sim
from study.config import Study, StudyError
from vsh import Field
from vsh.tools.files import write_arrays


def prepared(
    study: Study,
    case: dict[str, Any],
    kind: Literal["quasars", "vlbi", "galaxies"],
    folder: Path,
    progress: bool = True,
) -> Path:
    """The file with the sources of one kind, made if it is not there."""
    wanted = {"kind": kind, "sources": case[kind], "mission": study.mission, "seed": study.settings["seed"]}
    if kind == "galaxies":  # how they are seen is no matter of theirs
        wanted["sources"] = {key: value for key, value in case[kind].items() if key != "redshifts"} | {"columns": 2}
    wanted |= {"frame": study.settings["frame"]} | ({"quasars": case["quasars"]} if kind == "vlbi" else {})
    return kept(folder, kind, wanted, lambda _: _make(study, case, kind, progress))


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
    skies, chosen, gaps = np.random.default_rng(study.settings["seed"]).spawn(3)
    mission = study.mission
    return skies, chosen, sim.NominalScanningLaw(years=mission["years"], dead_time=mission["dead_time"], rng=gaps)


def galaxies_of(case: dict[str, Any], skies: np.random.Generator) -> sim.Population:
    """The galaxies of a case."""
    galaxies = case["galaxies"]
    limits = {name: galaxies[name] for name in ("min_redshift", "max_redshift")}
    return sim.galaxies(galaxies["number"], skies.spawn(1)[0], galaxies["sky"], **limits)


def _make(study, case, kind, progress):
    mission = study.mission
    skies, chosen, law = streams_and_law(study)
    quasars, options = case["quasars"], {"progress": progress}
    seen = sim.Mission(law, mission["release"], mission["attitude"])
    try:
        if kind == "galaxies":
            population = galaxies_of(case, skies)
            options["excess_noise"] = case["galaxies"]["excess_noise"]
        else:
            population = sim.quasars(quasars["number"], skies, quasars["sky"])
            if kind == "vlbi":
                population = sim.vlbi_quasars(population, case["vlbi"]["number"], chosen)
            if quasars["variability"]:
                options["variability"] = sim.Variability(quasars["variability"], quasars["tau"])
        parameters: Any = "position" if kind == "vlbi" else "motion"
        formal, true = sim.expected_covariances(population, seen, parameters, **options)
    except ValueError as error:
        raise StudyError(f"case {case['name']}, {kind}: {error}") from error
    good = np.isfinite(formal[:, 0, 0])
    population, formal, true = population[good], formal[good], true[good]
    if kind == "vlbi":
        # The radio positions scatter, and theirs are the errors that are quoted: what the paper's formal
        # errors of ε are (100 µas / √(3300 · 2/3) = 2.1 µas), and why its scatter is half as large again.
        radio = case["vlbi"]["radio"] ** 2 * np.eye(2)
        formal, true = np.broadcast_to(radio, formal.shape), true + radio
    frame = study.settings["frame"]
    quoted, scattered = (_turned(population, each, frame) for each in (formal, true))
    s1, s2 = scattered.sigma
    arrays = {
        "lon": quoted.lon,
        "lat": quoted.lat,
        "sigma": quoted.sigma,
        "rho": quoted.rho,
        # L of the true covariance, L Lᵀ: noise is L times unit normals.
        "noise": np.stack([s1, scattered.rho * s2, s2 * np.sqrt(1 - scattered.rho**2)]),
    }
    return arrays | ({"redshift": population.redshift, "magnitude": population.magnitude} if kind == "galaxies" else {})


def _turned(population, covariance, frame):
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    rho = covariance[:, 0, 1] / (sigma[0] * sigma[1])
    field = Field(population.lon, population.lat, np.zeros_like(sigma), sigma, rho, frame=population.frame)
    return field.to_frame(frame)
