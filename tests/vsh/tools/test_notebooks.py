"""Every public object has a form for notebooks, and gives it."""

import importlib
import inspect
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from every_result import RESULTS, result_of

import fit
import sim
import vsh
from fit import distances, posterior
from sim import agis
from study.forecast import SURVEYS, forecast_surveys
from vsh.io import archive, catalogue, tables
from vsh.io.parts import InProcess
from vsh.models import covariance, flows
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.sky.frames import Positions

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


def objects():
    """One object of each public class that is no result and does not take long, made as in a notebook."""
    quasars = sim.quasars(3000, rng=1)
    signal = sim.spin((1.0, -2.0, 0.5)) + sim.acceleration((0.0, -4.0, -2.0))
    law = sim.NominalScanningLaw(years=1.0, rng=1)
    mission = sim.Mission(law, "DR4")
    field = sim.observe(quasars, signal, rng=2, sigma=20.0)
    yield from (quasars, signal, law, mission, field, sim.Variability(100.0, 2.0))
    yield law.transits(quasars.lon[:50], quasars.lat[:50])
    yield vsh.ScalarField(field.lon, field.lat, np.zeros(3000), np.ones(3000), "µas")
    yield Positions(field.lon, field.lat, field.sigma)
    yield from (vsh.Modes(3), vsh.ScalarModes(2), vsh.Coefficients.from_vectors(rotation=(1, 2, 3), glide=(0, -4, -2)))
    yield from (CMB_VELOCITY_PLANCK18, tables.open_table(field.to_table()), archive.DR4, InProcess())
    yield tables.Where("phot_g_mean_mag < 19 and 0.5 < redshift < 2")
    yield catalogue.Columns(pmra="mu_ra", pmdec="mu_dec")
    yield catalogue.parts([field[:1000], field[1000:]])
    yield fit.normal_equations(field, 3)
    yield covariance.from_spectrum(field[:40], spectrum := covariance.Spectrum.flat(), 6)
    yield spectrum
    galaxies = sim.galaxies(2000, rng=3, min_redshift=0.005)
    drift = sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value, hubble=70.0)
    nearby = sim.observe(galaxies, drift, rng=4, sigma=2.0)
    yield from (posterior.Flat(20, 150), posterior.Normal(70, 5))
    options = {"n_samples": 150_000, "rng": 5, "redshift_frame": "true", "progress": False}
    yield posterior.sample(nearby, CMB_VELOCITY_PLANCK18, (70, 5), **options)
    yield (modes := flows.flow_modes(20.0, 120.0, 60))
    yield from (modes.theory, flows.VelocityGrid(np.zeros((3, 8, 8, 8)), 100.0))
    yield distances.calibrate(nearby, "true")
    yield (mixture := agis.mixture(mission, quasars[:200]))
    system, _ = agis.joint_system(law, mixture.lon, mixture.lat, mixture.sigma, progress=False)
    yield from (system, system.scans, agis.plan(law, quasars.lon, quasars.lat), SURVEYS["VLBI"])
    yield system.solve(*agis.observations(system.scans, 6), iterations=100, progress=False)
    yield forecast_surveys({"VLBI": SURVEYS["VLBI"]}, flows=False)


@pytest.mark.slow
def test_notebook_of_every_object_runs():
    """Each form is whole HTML."""
    shown = [*objects(), *map(result_of, RESULTS)]
    for each in shown:
        parser = Balanced()
        parser.feed(each._repr_html_())
        assert parser.open == [], type(each)
    # Results of long runs are shown where they are made.
    assert len({type(each) for each in shown} & set(public_classes())) > 55
