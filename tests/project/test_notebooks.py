"""Every public object has a form for notebooks, and gives it."""

import importlib
import inspect
from html.parser import HTMLParser
from pathlib import Path

import pytest
from conftest import ROOT

#: What nobody holds in a notebook: parts of the machinery, panels of pages, axes (matplotlib shows them).
INTERNAL = {
    "Axis", "Prior", "Run", "ParallaxEquations", "ParallaxParts", "ParallaxSums", "Rings", "Passes", "Panel", "ShownPage", "Tree",
    "SkyAxes", "Answer", "TableIO", "SourcesWithErrors", "Frozen",
}  # fmt: skip


def public_classes():
    found = {}
    for package in ("vsh", "sim", "fit", "study"):
        for path in Path(ROOT, package).rglob("__init__.py"):
            face = importlib.import_module(".".join(path.relative_to(ROOT).parts[:-1]))
            for name in getattr(face, "__all__", ()):
                thing = getattr(face, name)
                if inspect.isclass(thing) and not issubclass(thing, (BaseException, tuple)):
                    found[thing] = name
    return [thing for thing, name in found.items() if name not in INTERNAL]


@pytest.mark.parametrize("kind", public_classes(), ids=lambda kind: kind.__name__)
def test_every_public_object_has_a_form_for_notebooks(kind):
    assert callable(getattr(kind, "_repr_html_", None))


class Balanced(HTMLParser):
    """Counts tags that are opened and closed."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("br", "img", "hr", "meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def make_objects():
    """One object of each public class that does not take long, made as in a notebook."""
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

    shown = []

    def show(thing):
        shown.append(thing)
        return thing

    quasars = show(sim.quasars(3000, rng=1))

    signal = show(sim.spin((1.0, -2.0, 0.5)) + sim.acceleration((0.0, -4.0, -2.0)))

    law = show(sim.NominalScanningLaw(years=1.0, rng=1))

    mission = show(sim.Mission(law, "DR4"))

    show(sim.Variability(100.0, 2.0))

    show(law.transits(quasars.lon[:50], quasars.lat[:50]))

    field = show(sim.observe(quasars, signal, rng=2, sigma=20.0))

    show(vsh.ScalarField(field.lon, field.lat, np.zeros(3000), np.ones(3000), "µas"))

    show(Positions(field.lon, field.lat, field.sigma))

    show(vsh.Modes(3))

    show(vsh.ScalarModes(2))

    show(vsh.Coefficients.from_vectors(rotation=(1, 2, 3), glide=(0, -4, -2)))

    show(CMB_VELOCITY_PLANCK18)

    show(tables.open_table(field.to_table()))

    show(tables.Where("phot_g_mean_mag < 19 and 0.5 < redshift < 2"))

    show(catalogue.Columns(pmra="mu_ra", pmdec="mu_dec"))

    show(catalogue.parts([field[:1000], field[1000:]]))

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

    show(background.floor(normal))

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

    show(secular_parallax.observer_velocity(nearby, 70.0, redshift_frame="true"))

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

    return shown


@pytest.mark.slow
def test_notebook_of_every_object_runs():
    """Each form is whole HTML."""
    objects = make_objects()
    shown = {type(each) for each in objects}
    for each in objects:
        parser = Balanced()
        parser.feed(each._repr_html_())
        assert parser.open == [], type(each)
    # Results of long runs are shown where they are made; these at least are here.
    assert {kind.__name__ for kind in shown} >= {
        "Field",
        "Solution",
        "Vector",
        "Modes",
        "NormalEquations",
        "Population",
        "Signal",
        "Floor",
    }
    assert len(shown) >= 40
