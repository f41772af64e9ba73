"""Forecasts of surveys: the numbers of even skies, and what they follow from."""

import numpy as np
import pytest

import fit
import sim
from sim.astrometry import POSITION_FACTORS, gaia_errors, parallax_error
from study.commands.forecast import main
from study.forecast import SURVEYS, SecondEpoch, Survey, forecast_surveys
from study.forecast._forecast import QUANTITIES, _draw_crf3_magnitudes_and_factors
from vsh import Field, ParameterError
from vsh.figures.plot import figure_of
from vsh.tools.units import hubble_rate


@pytest.fixture(scope="module")
def found():
    return forecast_surveys()


def values_of(survey, **options):
    return forecast_surveys({"mine": survey}, **options).values["mine"]


def test_numbers_of_even_skies(found):
    """Within 5 % of those worked out by hand for Gaia-CRF3's counts; within 12 % for the 10⁵ galaxies that are drawn."""
    expected = {
        "spin": (0.361, 0.152, 0.053), "acceleration": (0.361, 0.152, 0.053), "waves": (5.2e-2, 9.2e-3, 1.13e-3),
        "velocity": (63, 31, 15.6), "hubble": (11.4, 5.7, 2.9),
    }  # fmt: skip
    for name, row in expected.items():
        for survey, value in zip(("Gaia DR3", "Gaia DR4", "Gaia DR5"), row, strict=True):
            within = 0.12 if name in ("velocity", "hubble") else 0.05
            assert found.values[survey][name] == pytest.approx(value, rel=within), (name, survey)


def test_quantities_that_follow_from_the_acceleration(found):
    for survey, values in found.values.items():
        a = values["acceleration_floor"]
        assert values["direction"] == pytest.approx(np.degrees(a / fit.galaxy.expected_acceleration(8.275)), rel=1e-9)
        assert values["r0"] == pytest.approx(
            8.275 * np.hypot(a / 4.861, 2 * np.hypot(0.008 * 4.74047, 2.1 / 8.178) / 28.894), rel=1e-3
        )
        assert a == pytest.approx(np.hypot(values["acceleration"], SURVEYS[survey].floor), rel=1e-9)
        # σ(ḣ) = σ_µ √(6/N), σ_a = σ_µ √(3/2N): twice as large.
        assert values["wave"] == pytest.approx(2 * values["acceleration"], rel=0.02)


def test_second_epoch_serves_galaxies_too():
    """Those in its part of the sky, by the astrometry of each and a position years later; the others as before."""
    second = SecondEpoch(350.0, 10.0, declination=(-45.0, 0.0))
    survey, alone = Survey(10, "DR5", n_galaxies=10, second=second), Survey(10, "DR5", n_galaxies=10)
    magnitude = np.array([15.0, 18.0, 20.0, 18.0])
    lon, lat = np.full(4, 1.0), np.radians([-30.0, -20.0, -10.0, 20.0])
    errors, before = survey.galaxy_errors(magnitude, lon, lat), alone.galaxy_errors(magnitude, lon, lat)
    np.testing.assert_array_equal(before, gaia_errors(magnitude, "DR5"))
    np.testing.assert_array_equal(errors[:, 3], before[:, 3])
    np.testing.assert_allclose(errors[:, :3], second.motion_errors(magnitude[:3], np.ones(3), "DR5"))
    assert (errors[:, :3] < before[:, :3]).all()
    assert (errors[:, 2] < 0.8 * before[:, 2]).all()


def test_survey_of_few_sources_beside_its_own_fit():
    """400 simulated skies of the same sources: scatter as forecast."""
    values = values_of(Survey(500, sigma=20.0))
    rng, seen, shears = np.random.default_rng(1), [], []
    for _ in range(400):
        lon, lat = sim.uniform_sky(500, rng)
        errors = np.full((2, 500), 20.0)
        solution = fit.fit_field(Field(lon, lat, errors * rng.normal(size=(2, 500)), errors), 2)
        seen.append(solution.acceleration.value)
        shears.append(fit.shear.expansion(solution).tensor)
    assert np.std(seen) == pytest.approx(values["acceleration"], rel=0.06)
    percent = 100 * np.sqrt(np.mean(np.square(shears))) / hubble_rate(70)
    assert percent == pytest.approx(values["shear"], rel=0.06)
    assert np.isnan(values["velocity"])


def test_floor_of_dr3_is_that_of_its_published_systematics():
    """12 µas/yr rms in degrees 1 to 12, one power for all 336 modes: 3 s/8π of it in each component."""
    power_per_mode = 4 * np.pi * 12.0**2 / 336
    assert SURVEYS["Gaia DR3"].floor == pytest.approx(np.sqrt(3 * power_per_mode / (8 * np.pi)), rel=1e-12)
    assert 0.72 < SURVEYS["Gaia DR3"].floor < 0.85  # by the powers of EDR3's quasars, for several spectra


@pytest.mark.slow
def test_scatter_with_second_epoch():
    """400 skies of sources of which those at |b| > 30° have positions of another survey: scatter as forecast."""
    second = SecondEpoch(300.0, 10.0, latitude=30.0)
    survey = Survey(4000, "DR5", second=second)
    values = forecast_surveys({"both": survey, "Gaia": Survey(4000, "DR5")}, flows=False).values
    rng = np.random.default_rng(2)
    magnitudes, factors = _draw_crf3_magnitudes_and_factors()
    accelerations = []
    for _ in range(400):
        lon, lat = sim.uniform_sky(4000, rng)
        draws = rng.integers(len(magnitudes), size=4000)
        errors = factors[draws] * sim.gaia_errors(magnitudes[draws], "DR5")
        inside = second.covers(lon, lat)
        errors[:, inside] = second.motion_errors(magnitudes[draws][inside], factors[draws][inside], "DR5")
        solution = fit.fit_field(Field(lon, lat, errors * rng.normal(size=errors.shape), errors), 2)
        accelerations.append(solution.acceleration.value)
    assert np.std(accelerations) == pytest.approx(values["both"]["acceleration"], rel=0.06)
    assert values["both"]["acceleration"] < 0.9 * values["Gaia"]["acceleration"]


def test_errors_by_source_are_shares():
    """Errors of 5 and 20 in equal shares have the information of one error of 6.86."""
    two, one = (values_of(Survey(1000, sigma=sigma)) for sigma in ((5.0, 20.0), np.sqrt(2 / 0.0425)))
    assert two["acceleration"] == pytest.approx(one["acceleration"], rel=1e-12)


def test_errors_scale_as_they_must():
    one, four = (values_of(Survey(n, sigma=10.0, n_galaxies=n), flows=False) for n in (1000, 4000))
    for name in ("spin", "acceleration", "shear", "wave", "velocity"):
        assert four[name] == pytest.approx(one[name] / 2, rel=1e-6)
    assert four["waves"] == pytest.approx(one["waves"] / 4, rel=1e-6)
    assert np.isnan(one["hubble_flows"])


def test_other_skies_are_worse():
    even, plane = (values_of(Survey(1000, sigma=10.0), sky=sky) for sky in ("uniform", "gums"))
    assert plane["spin"] > 1.005 * even["spin"]


def test_report_table_and_figure(found):
    text = found.report()
    assert "are assumptions" in text
    assert "nan" not in text
    table = found.to_table()
    assert set(QUANTITIES) < set(table.colnames)
    assert len(table) == len(SURVEYS)
    figure_of(found.plot()).canvas.draw()


def test_messages(capsys):
    with pytest.raises(ParameterError, match="at least, by name"):
        forecast_surveys({})
    with pytest.raises(ParameterError, match="at least, by name"):
        forecast_surveys({"a": 3})
    with pytest.raises(ParameterError, match="sky must be one of"):
        forecast_surveys(sky="flat")
    with pytest.raises(ParameterError, match="one of the two"):
        Survey(100)
    with pytest.raises(ParameterError, match="n_quasars must be a whole number"):
        Survey(0, sigma=1.0)
    with pytest.raises(ParameterError, match="astrometry of a release"):
        Survey(10, sigma=1.0, second=SecondEpoch(1.0, 1.0))
    assert main(["--only", "Gaia DR9"]) == 1
    assert "no survey is called 'Gaia DR9'" in capsys.readouterr().err
    for bad in ("mine", "mine=3", "mine=3.5,1", "=3,1", "mine=3,0"):
        with pytest.raises(SystemExit):
            main(["--survey", bad])


def test_command(tmp_path, capsys):
    folder = tmp_path / "forecast"
    words = ["--only", "VLBI", "--only", "SKA", "--survey", "mine=3000,2", "--survey", "other=500,9", "--no-flows"]
    assert main([*words, "--output", str(folder)]) == 0
    made = {"report.txt", "forecast.ecsv", "forecast.png", "provenance.json", "run.toml", "citation.bib"}
    assert {x.name for x in folder.iterdir()} == made
    text = capsys.readouterr().out
    assert all(name in text for name in ("VLBI", "SKA", "mine", "other"))
    # The run repeats itself, options given twice too.
    again = ["--config", str(folder / "run.toml"), "--output", str(tmp_path / "again")]
    assert main(again) == 0
    assert (tmp_path / "again" / "report.txt").read_text() == (folder / "report.txt").read_text()


def test_positions_may_have_the_errors_of_a_release():
    """After a long time a motion is the difference of two positions, whose errors follow the magnitude."""
    magnitude, factor, years = np.array([17.0, 20.0]), np.array([1.0, 1.3]), 1e4
    errors = SecondEpoch("DR4", years).motion_errors(magnitude, factor, "DR5")
    positions = [np.multiply.outer(POSITION_FACTORS, parallax_error(magnitude, name)) for name in ("DR4", "DR5")]
    np.testing.assert_allclose(errors, factor * np.hypot(*positions) / years, rtol=1e-5)
    own = SURVEYS["near infrared"].second
    ratio = gaia_errors(magnitude, "DR4") / own.motion_errors(magnitude, np.ones(2), "DR5")
    assert (ratio > 14).all()  # after 20 years, by Hobbs et al. (2021)
    assert (ratio < 14 * 27.7 / 20 * 1.1).all()


def test_survey_without_a_floor_is_not_said_to_have_one():
    surveys = {"mine": Survey(1_000_000, sigma=300.0), "Gaia DR4": SURVEYS["Gaia DR4"]}
    lines = dict(forecast_surveys(surveys).answer.lines)
    assert "no systematic floor assumed" in lines["mine"]
    assert "systematic floor included" in lines["Gaia DR4"]
