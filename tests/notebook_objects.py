"""One object of each public class, made as in a notebook: `OBJECTS`, which test_notebooks.py shows."""

import numpy as np

import fit
import sim
import vsh
from fit import (
    background,
    compare,
    correlation,
    distances,
    galaxy,
    pairs,
    posterior,
    redshift,
    resample,
    robust,
    secular_parallax,
    shear,
    waves,
)
from sim import agis
from study.forecast import SURVEYS
from study.forecast import forecast_surveys as survey_forecast
from vsh.io import archive, catalogue, tables
from vsh.io.parts import InProcess
from vsh.models import covariance, flows
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.sky.frames import Positions

OBJECTS = []


def show(thing):
    """Keep it, and give it back."""
    OBJECTS.append(thing)
    return thing


quasars = show(sim.quasars(3000, rng=1))

signal = show(sim.spin((1.0, -2.0, 0.5)) + sim.acceleration((0.0, -4.0, -2.0)))

law = show(sim.NominalScanningLaw(years=1.0, rng=1))

mission = show(sim.Mission(law, "DR4"))

show(sim.Variability(100.0, 2.0))

transits = show(law.transits(quasars.lon[:50], quasars.lat[:50]))

field = show(sim.observe(quasars, signal, rng=2, sigma=20.0))

show(vsh.ScalarField(field.lon, field.lat, np.zeros(3000), np.ones(3000), "µas"))

show(Positions(field.lon, field.lat, field.sigma))

show(vsh.Modes(3))

show(vsh.ScalarModes(2))

coefficients = show(vsh.Coefficients.from_vectors(rotation=(1, 2, 3), glide=(0, -4, -2)))

show(CMB_VELOCITY_PLANCK18)

show(tables.open_table(field.to_table()))

show(tables.Where("phot_g_mean_mag < 19 and 0.5 < redshift < 2"))

show(catalogue.Columns(pmra="mu_ra", pmdec="mu_dec"))

sky = show(catalogue.parts([field[:1000], field[1000:]]))

show(archive.DR4)

show(InProcess())

normal = show(fit.normal_equations(field, 3))

solution = show(fit.solve(normal))

show(solution.acceleration)

show(fit.Moments.of(field, 3))

show(fit.solve_frame(field))

show(fit.cross_check(field))

show(fit.clip(field, 1, 3))

show(robust.student_t(field, 1))

show(robust.excess_noise(field, 1))

show(resample.bootstrap(field, 1, 20, rng=1))

shared = show(covariance.Spectrum.flat())

show(covariance.from_spectrum(field[:40], shared, 6))

floor = show(background.floor(normal))

show(background.wave_limit(solution))

show(pairs.correlation_function(field, np.radians(np.linspace(0, 180, 8)), nside=1))

show(shear.expansion(solution))

show(waves.search(normal, n_skies=50, nside=4))

comparison, _ = compare.compare_catalogues(field, field, 1, by="position")
show(comparison)

show(correlation.correlation_matrices([field], "spin+acceleration", labels=["this sky"]))

show(correlation.predict_covariance(field, 1))

show(correlation.leakage(field, 1, 3))

galaxies = sim.galaxies(2000, rng=3, min_redshift=0.005)
drift = sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value, hubble=70.0)
nearby = show(sim.observe(galaxies, drift, rng=4, sigma=2.0))

show(redshift.binned(nearby, 1, 3))

velocity = show(secular_parallax.observer_velocity(nearby, 70.0, redshift_frame="true"))

show(secular_parallax.hubble_constant(nearby, CMB_VELOCITY_PLANCK18, redshift_frame="true"))

show(posterior.Flat(20, 150))

show(posterior.Normal(70, 5))

chain = show(
    posterior.sample(
        nearby, CMB_VELOCITY_PLANCK18, (70, 5), n_samples=150_000, rng=5, redshift_frame="true", progress=False
    )
)

show(chain.kept())

show(posterior.grid(nearby, CMB_VELOCITY_PLANCK18, (70, 5), redshift_frame="true"))

modes = show(flows.flow_modes(20.0, 120.0, 60))

show(modes.theory)

show(flows.VelocityGrid(np.zeros((3, 8, 8, 8)), 100.0))

calibration = show(distances.calibrate(nearby, "true"))

show(distances.inverse_distances(nearby, calibration))

show(galaxy.orbit(solution))

mixture = show(agis.mixture(mission, quasars[:200]))

system, _ = agis.joint_system(law, mixture.lon, mixture.lat, mixture.sigma, progress=False)
show(system)

show(system.scans)

show(system.solve(*agis.observations(system.scans, 6), iterations=100, progress=False))

show(agis.plan(law, quasars.lon, quasars.lat))

show(SURVEYS["VLBI"])

forecast = survey_forecast({"VLBI": SURVEYS["VLBI"]}, flows=False)
show(forecast)

forecast.plot()
