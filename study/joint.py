"""Realisations whose attitude is solved together with the sources: one joint solution each (`sim.agis`)."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import sim
from sim import agis
from study.config import Study, StudyError
from study.prepare import galaxies_of, kept, streams_and_law
from vsh import Field
from vsh.system.files import read_arrays


def prepared_sources(study: Study, case: dict[str, Any], folder: Path, progress: bool = True) -> Path:
    """The file with all sources of a case and the folder with their transits, made if they are not there."""
    wanted = {"sources": {key: value for key, value in case.items() if key != "name"}, "mission": study.mission, "seed": study.settings["seed"]}  # fmt: skip
    return kept(folder, "joint", wanted, lambda path: _make_joint(study, case, path.with_suffix(""), progress))


def _make_joint(study, case, scans, progress):
    """The sources of a case, and the folder of their transits."""
    mission = study.mission
    skies, chosen, law = streams_and_law(study)
    seen = sim.Mission(law, mission["release"], "solved", mission["knots"])
    try:
        quasars = sim.quasars(case["quasars"]["number"], skies, case["quasars"]["sky"])
        galaxies, excess = None, 0.0
        if "galaxies" in case:
            galaxies, excess = galaxies_of(case, skies), case["galaxies"]["excess_noise"]
        mixture = agis.mixture(seen, quasars, galaxies, excess_noise=excess)
        vlbi = np.zeros(0, int)
        if "vlbi" in case:
            vlbi = np.sort(chosen.choice(len(quasars), case["vlbi"]["number"], replace=False))
        agis.joint_system(law, mixture.lon, mixture.lat, mixture.sigma, knots=mission["knots"], number=len(quasars),
                          folder=scans, progress=progress)  # fmt: skip
    except ValueError as error:
        raise StudyError(f"case {case['name']}: {error}") from error
    arrays = {each.name: getattr(mixture, each.name) for each in fields(mixture)}
    return arrays | {"vlbi": vlbi, "gaps": law.lost}


def solved_errors(study: Study, case: dict[str, Any], path: Path, rng: np.random.Generator) -> dict[str, Field]:
    """One draw of all observations, solved: errors of motions, and of offsets from radio positions, by kind of source."""
    system, mixture, vlbi = _system(path, json.dumps(study.mission, sort_keys=True))
    noise, radio = rng.spawn(2)
    told = case["quasars"]
    variability = sim.Variability(told["variability"], told["tau"]) if told["variability"] else None
    observed = agis.observations(system.scans, noise, variability=variability, variable=mixture.are("quasars"))
    solution = agis.in_own_frame(system, system.solve(*observed, sources=mixture.are("quasars")))
    frame = study.settings["frame"]
    columns = {"redshift": mixture.redshift, "magnitude": mixture.magnitude}
    found = {"quasars": solution.field(sources=mixture.are("quasars"))}
    if "galaxies" in case:
        found["galaxies"] = replace(solution.field(sources=mixture.are("galaxies"), **columns), redshift_frame="true")
    if "vlbi" in case:
        offsets = solution.field(sources=vlbi, kind="position")
        sigma = np.full(offsets.sigma.shape, case["vlbi"]["radio"])
        # The radio positions scatter, and theirs are the errors that are quoted, as in `study.prepare`.
        motion = offsets.motion + sigma * radio.standard_normal(sigma.shape)
        found["vlbi"] = replace(offsets, motion=motion, sigma=sigma, rho=np.zeros(len(offsets)))
    return {kind: field.to_frame(frame) for kind, field in found.items()}


@lru_cache(maxsize=1)
def _system(path, mission):
    """The equations of a prepared file; its transits are mapped into memory."""
    told = json.loads(mission)
    arrays = read_arrays(path)
    vlbi, gaps = arrays.pop("vlbi"), arrays.pop("gaps")
    mixture = agis.Mixture(**arrays)
    law = sim.NominalScanningLaw(years=told["years"], gaps=tuple(map(tuple, gaps)))
    system, _ = agis.joint_system(
        law, mixture.lon, mixture.lat, mixture.sigma, knots=told["knots"], number=int(mixture.are("quasars").sum()),
        folder=path.with_suffix(""), threads=1,
    )  # fmt: skip
    return system, mixture, vlbi
