"""What has a unit is converted to that of the package or refused, at every public door; it is never stripped."""

import importlib
import inspect
import pkgutil

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.table import QTable

import fit
import sim
import vsh
from vsh import Field, Vector
from vsh.basis import harmonics
from vsh.models.waves import wave_motions
from vsh.sky.pixels import pixels_of
from vsh.sky.sphere import triad
from vsh.tools.errors import FieldError, ParameterError
from vsh.transform import adjoint, synthesis

N = 50
RNG = np.random.default_rng(1)
LON, LAT = RNG.uniform(0, 6, N), RNG.uniform(-1, 1, N)
MOTION = RNG.normal(size=(2, N))
SOLUTION = fit.fit_field(Field(LON, LAT, MOTION, np.ones((2, N))), 2)
SCALARS = vsh.scalars.ScalarCoefficients(vsh.modes.ScalarModes(1), np.arange(4.0))

#: Every public function with a longitude and a latitude.
CALLS = {
    "vsh.sky.sphere.triad": triad,
    "vsh.sky.pixels.pixels_of": lambda lon, lat: pixels_of(lon, lat, 8),
    "vsh.transform.synthesis": lambda lon, lat: synthesis(SOLUTION.coefficients, lon, lat),
    "vsh.transform.adjoint": lambda lon, lat: adjoint(2, lon, lat, MOTION),
    "vsh.basis.harmonics": lambda lon, lat: harmonics(lon, lat, 2),
    "vsh.models.waves.wave_motions": lambda lon, lat: wave_motions(lon, lat, (0.0, 0.0, 1.0), 1e-3),
    "Coefficients.at": lambda lon, lat: SOLUTION.coefficients.at(lon, lat),
    "ScalarCoefficients.at": lambda lon, lat: SCALARS.at(lon, lat),
    "Solution.predict": lambda lon, lat: SOLUTION.predict(lon, lat),
    "Prediction.predict": lambda lon, lat: SOLUTION.predict(lon, lat),
    "Template.of_sources": lambda lon, lat: fit.background.Template.of_sources("t", lon, lat, LON).source.lon,
}
#: Of simulations of Gaia and of figures, which take what others made; results and nouns, which check their arrays.
ELSEWHERE = ("sim.", "vsh.figures.", "SkyAxes.", "vsh.models.", "Flow", "VelocityGrid", "System", "Unknowns",
             "Response", "NominalScanningLaw")  # fmt: skip


def public():
    """Names of the public functions that have a longitude among their parameters."""
    for package in (vsh, fit, sim):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if "commands" in info.name or "._" in info.name or "__main__" in info.name:
                continue
            module = importlib.import_module(info.name)
            for name in getattr(module, "__all__", ()):
                thing = getattr(module, name)
                members = inspect.getmembers(thing, inspect.isroutine) if inspect.isclass(thing) else [(None, thing)]
                for member, function in members:
                    if callable(function) and not inspect.isclass(function) and not (member or "x").startswith("_"):
                        yield f"{thing.__name__}.{member}" if member else f"{info.name}.{name}", function


def test_every_public_function_with_places_is_tried():
    found = set()
    for name, function in public():
        try:
            parameters = inspect.signature(function).parameters
        except (TypeError, ValueError):
            continue
        if {"lon", "lat"} <= set(parameters) and not name.startswith(ELSEWHERE):
            found.add(name)
    assert found <= set(CALLS)


@pytest.mark.parametrize("name", CALLS)
def test_places_in_degrees_are_those_in_radians(name):
    call = CALLS[name]
    coord = SkyCoord(LON * u.rad, LAT * u.rad)
    table = QTable({"lon": np.degrees(LON) * u.deg, "lat": np.degrees(LAT) * u.deg})
    for lon, lat in ((np.degrees(LON) * u.deg, np.degrees(LAT) * u.deg), (coord.ra, coord.dec), table.columns.values()):
        np.testing.assert_allclose(call(lon, lat), call(LON, LAT), rtol=1e-10, atol=1e-12)
    with pytest.raises((ParameterError, FieldError)):
        call(LON * u.m, LAT)


def test_vectors_and_errors_are_converted():
    unit = u.mas / u.yr
    np.testing.assert_allclose(Vector([0.0, 0.0, 1.0] * unit, np.eye(3)).value, [0, 0, 1000])
    np.testing.assert_allclose(Vector([0.0, 0.0, 1.0] * u.km / u.s, np.eye(3), unit="km/s").value, [0, 0, 1])
    with pytest.raises(ParameterError, match="cannot be turned into uas/yr"):
        Vector([0.0, 0.0, 1.0] * u.km / u.s, np.eye(3))
    with pytest.raises(ParameterError, match="without a unit"):
        Vector([0.0, 0.0, 1.0], np.eye(3) * unit**2)
    quasars = sim.quasars(20, rng=1)
    plain, converted = (sim.observe(quasars, sim.spin((0, 0, 1)), 2, sigma=each) for each in (20.0, 0.02 * unit))
    np.testing.assert_allclose(converted.motion, plain.motion)
    with pytest.raises(ParameterError, match="sigma is in mas"):
        sim.observe(quasars, sim.spin((0, 0, 1)), 2, sigma=20.0 * u.mas)


@pytest.mark.parametrize("column", ["lon", "lat", "motion", "sigma", "rho"])
def test_masked_values_of_every_array_are_refused(column):
    arrays = {"lon": LON, "lat": LAT, "motion": MOTION, "sigma": np.ones((2, N)), "rho": np.zeros(N)}
    mask = np.zeros(arrays[column].shape, bool)
    mask[..., 7] = True
    with pytest.raises(FieldError, match="1 of 50 rows cannot be used.*row 7"):
        Field(**arrays | {column: np.ma.MaskedArray(arrays[column], mask)})
