"""Names of the release before this one still work, and say what they are called now."""

import importlib
import subprocess
import sys

import pytest
from conftest import ROOT

import vsh
from vsh.tools.modules import MODULES


@pytest.mark.parametrize(("old", "new"), MODULES.items())
def test_a_module_by_its_old_name_is_the_module(old, new):
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} is now {new};"):
        module = importlib.import_module(old)
    assert module is importlib.import_module(new)
    assert module.__spec__.name == new


def test_old_names_are_attributes_too():
    vars(vsh).pop("catalogue", None)
    with pytest.warns(DeprecationWarning, match="vsh.catalogue is now vsh.io.catalogue"):
        assert vsh.catalogue is vsh.io.catalogue


def test_the_warning_names_the_line_that_asked(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("import vsh\nfrom vsh.catalogue import read_field\nvsh.cosmology\nfrom vsh import archive\n")
    done = subprocess.run([sys.executable, script], cwd=ROOT, capture_output=True, text=True, check=True)
    for line, name in ((2, "catalogue"), (3, "cosmology"), (4, "archive")):
        assert f"mine.py:{line}: DeprecationWarning: vsh.{name} is now" in done.stderr


@pytest.mark.parametrize(("module", "old", "new"), [
    ("vsh.models.cosmology", "PLANCK_2018", "CMB_VELOCITY_PLANCK18"), ("vsh.models.cosmology", "PLANCK_2013", "FLAT_PLANCK13"),
    ("vsh.models.flows", "PLANCK_2018", "LINEAR_PLANCK18"), ("vsh.models.covariance", "read", "read_covariance"),
    ("vsh.io.tables", "read", "read_table"), ("fit.compare", "compare", "compare_catalogues"),
    ("fit.background", "compare", "compare_models"), ("fit.background", "fit", "fit_amplitudes"),
    ("fit.correlation", "predict", "predict_covariance"), ("fit.pairs", "correlation", "correlation_function"),
    ("fit.secular_parallax", "predict", "predict_errors"), ("fit.secular_parallax", "forecast", "forecast_velocity"),
    ("fit.secular_parallax", "Forecast", "VelocityForecast"), ("study.forecast", "Forecast", "SurveyForecast"),
    ("study.forecast", "forecast", "forecast_surveys"), ("sim", "wave", "plane_wave"),
    ("sim", "gravitational_waves", "wave_background"), ("sim.signal", "wave", "plane_wave"),
    ("sim.astrometry", "solve", "solve_astrometry"),
])  # fmt: skip
def test_a_name_by_its_old_name(module, old, new):
    home = importlib.import_module(module)
    with pytest.warns(DeprecationWarning, match=f"{module}.{old} is now {module}.{new};"):
        assert getattr(home, old) is getattr(home, new)
    assert old not in dir(home) or module in ("fit.compare",)
    with pytest.raises(AttributeError):
        home.what_nobody_wrote  # noqa: B018


def test_priors_in_one_noun_still_work():
    import sim
    from fit.posterior import Flat, Priors, grid

    field = sim.observe(sim.galaxies(40, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
    with pytest.warns(DeprecationWarning, match="is now sample"):
        old = grid(field, priors=Priors("planck", Flat(20, 150)), flows=None, n_points=20)
    assert old == grid(field, "planck", Flat(20, 150), flows=None, n_points=20)


def test_older_ways_of_reading_and_writing_still_work(tmp_path):
    import fit
    import sim
    from vsh.io import catalogue

    field = sim.observe(sim.quasars(40, 1), sim.spin((1, 2, 3)), rng=1, sigma=5.0)
    with pytest.warns(DeprecationWarning, match=r"is now `field\.write"):
        catalogue.write_field(field, tmp_path / "q.fits")
    with pytest.warns(DeprecationWarning, match=r"is now `for field in vsh\.io\.catalogue\.parts"):
        parts = list(catalogue.iter_fields(tmp_path / "q.fits", rows=15))
    assert [len(each) for each in parts] == [15, 15, 10]
    with pytest.warns(DeprecationWarning, match=r"solution\.report"):
        assert fit.report(fit.fit_field(field, 1)) == fit.fit_field(field, 1).report()
