"""What a solved attitude takes of a changing sky, by the joint solution: fields come back whole."""

import numpy as np
import pytest
from exact_response import ExactResponse

import sim
from fit import in_time
from sim import agis
from vsh import ConvergenceError, FrameError, Modes
from vsh.basis import harmonics
from vsh.io.epochs import Observations

LAW = sim.NominalScanningLaw(years=1.0)
N = 150


@pytest.fixture(scope="module")
def system():
    rng = np.random.default_rng(3)
    lon, lat = rng.uniform(0, 2 * np.pi, N), np.arcsin(rng.uniform(-1, 1, N))
    sigma = rng.uniform(50, 300, N)
    return agis.System(agis.scans(LAW, lon, lat, sigma, 5 * sigma, knots=2 * 86400.0))


def epochs(system, fields):
    """What a user of the solution has, (2, k) displacements of every transit put in."""
    scans = system.scans
    sin, cos = scans.sin.astype(float), scans.cos.astype(float)
    along, across = fields[0] * sin + fields[1] * cos, fields[1] * sin - fields[0] * cos
    solution = system.solve(along, across, stop=None, iterations=300)
    taken, _ = system.predict(np.zeros((N, 5)), solution.attitude)
    order = np.argsort(scans.source, kind="stable")
    t = (scans.time() - scans.middle)[order]
    s, c = sin[order], cos[order]
    design = np.array([s, c, scans.along_factor[order].astype(float), s * t, c * t])
    error = 1 / np.sqrt(scans.weights[0, scans.source[order]])
    return Observations(
        scans.lon, scans.lat, scans.source[order], t, design, (along - taken)[order], error, np.arange(N)
    )


def test_fields_come_back(system):
    """Coefficients of two functions of time, to 1e-4 of their size; taken as known, the attitude has its share."""
    scans, modes = system.scans, Modes(2)
    functions = in_time.waves(2.3, span=(-0.5, 0.5))
    true = np.random.default_rng(4).normal(size=(2, len(modes))) * np.where(modes.degrees == 1, 0.0, 100.0)
    true[:, modes.slice_of("S", 1)] = 80.0
    at = functions(scans.time() - scans.middle)
    basis = harmonics(scans.lon, scans.lat, modes)
    fields = sum(np.einsum("p,pcn->cn", true[k], basis)[:, scans.source] * at[k] for k in range(2))
    seen = epochs(system, fields)
    solutions = [
        in_time.solve(in_time.normal_equations(seen, modes, functions, attitude=attitude))
        for attitude in (ExactResponse(system), "known")
    ]
    rest = modes.slice_of("T", 1).stop
    exact, known = (solution.values[:, rest:] - true[:, rest:] for solution in solutions)
    assert np.abs(exact).max() < 1e-2
    assert np.abs(known).max() > 20


def test_messages(system):
    with pytest.raises(ConvergenceError, match="templates are known to .* after 1 iterations"):
        ExactResponse(system, iterations=1).taken(Modes(1), in_time.waves(2.0))
    law = sim.NominalScanningLaw(years=1.0, frame="ecliptic")
    other = agis.System(agis.scans(law, system.scans.lon, system.scans.lat, 1.0, 5.0, knots=86400.0))
    with pytest.raises(FrameError, match="in ecliptic axes"):
        ExactResponse(other)
