"""What a command prints: the result to quote first, 25 lines at most, and the rest with --long and in the folder."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from conftest import real_catalogue

from fit.commands import compare, correlate, fit, link, pairs, redshift
from sim.commands import simulate
from study.commands import forecast, referee

DEMO = str(files("fit") / "demo.fits")
VLBA = "td2017_vlba_proper_motions.ecsv"
LINES = 25


@pytest.fixture(scope="module")
def galaxies(tmp_path_factory):
    path = str(tmp_path_factory.mktemp("galaxies") / "galaxies.fits")
    options = ["galaxies", "--number", "3000", "--velocity", "planck", "--seed", "1", "--quiet", "--output", path]
    assert simulate.main(options) == 0
    return path


def printed(main, options, capsys):
    assert main(options) == 0
    return capsys.readouterr().out


def check(main, options, capsys, most=LINES, first=None):
    """The report, short and whole; the first line begins with a label."""
    text = printed(main, options, capsys)
    assert len(text.splitlines()) <= most, text
    if first is not None:
        assert text.startswith(first)
    long = printed(main, [*options, "--long"], capsys)
    assert "full report: --long" in text
    assert "full report: --long" not in long
    assert len(long) > len(text)
    assert long.partition("\n\n")[0] == text.partition("\n\n")[0]
    return text


@pytest.mark.parametrize(("main", "options", "most", "first"), [
    pytest.param(fit.main, [DEMO], LINES + 1, "acceleration", id="fit"),  # the truth of a simulation takes two
    pytest.param(correlate.main, [DEMO], LINES, "demo", id="correlate"),
    pytest.param(pairs.main, [DEMO], LINES, "templates", id="pairs"),
    pytest.param(forecast.main, [], LINES, "Gaia DR3", id="forecast", marks=pytest.mark.slow),
])  # fmt: skip
def test_short_reports(main, options, most, first, capsys):
    check(main, options, capsys, most, first)


def test_waves_beside_a_fit(capsys):
    assert "\nwaves          h70² Ω < " in check(fit.main, [DEMO, "--waves"], capsys, LINES + 2, "acceleration")


def test_link(tmp_path, capsys):
    path = str(tmp_path / "link.fits")
    assert simulate.main(["link", "--number", "30", "--quiet", "--output", path]) == 0
    capsys.readouterr()
    check(link.main, [path], capsys, first="orientation")


def test_velocity_and_constant(galaxies, capsys):
    given = ["--h0", "67.4", "--flows", "no"]
    assert "\nvelocity " in check(redshift.main, [galaxies, *given], capsys, first="velocity")
    check(redshift.main, [galaxies, "--velocity", "planck", "--flows", "no"], capsys, first="H0")


def test_posterior_stands_alone_where_it_was_asked_for(galaxies, capsys):
    """No other H0 is printed below the one to quote."""
    given = ["--velocity", "planck", "--flows", "no", "--posterior", "--method", "grid"]
    text = check(redshift.main, [galaxies, *given], capsys, LINES + 2, "H0")
    assert "posterior" in text.splitlines()[0]
    assert "least squares" not in text
    limit = text.splitlines()[0].partition("< ")[2].split()[0]  # of a velocity that is not detected
    assert f"below {limit} with 95 %" in text


@pytest.mark.slow
def test_bins_beside_all_else(galaxies, capsys):
    given = ["--h0", "67.4", "--velocity", "planck", "--bins", "3"]
    check(redshift.main, [galaxies, *given], capsys, 2 * LINES, "H0")


@pytest.mark.slow
@pytest.mark.parametrize("command", [(compare, ["icrf3sx.txt", "icrf2-all.txt"]), (referee, [VLBA])])
def test_real_catalogues(command, capsys):
    module, names = command
    # Each list without a heading says how its errors were read.
    check(module.main, [str(real_catalogue(name)) for name in names], capsys, LINES + len(names) - 1)


def test_answer_of_waves_in_time():
    """A wave that is put in is told first, with where its frequency lies."""
    from fit.waves import WaveSpectrum

    limits = np.full((3, 3), 50.0) * [0.8, 1.0, 1.2]
    zero = np.zeros(3)
    spectrum = WaveSpectrum(
        frequencies=np.array([0.5, 1.0, 2.0]), statistic=np.array([4.0, 90.0, 5.0]), lon=zero, lat=zero, amplitudes=zero + 100.0, limits=limits,
        p_values=np.array([0.5, 1e-9, 0.4]), p_value=1e-3, lost=zero, n_skies=999, n_data=400, degrees=(2, 3),
    )  # fmt: skip
    (_, wave), (_, strain) = spectrum.answer.lines
    assert wave.startswith("detected in a search of 3 frequencies")
    assert wave.endswith("the largest at 1 per year")
    assert strain.startswith("4.8e-10 at 1 per year, as fitted; where there is no wave < 2.4e-10 to 2.4e-10")
    # More than on all of too few skies decides nothing.
    (_, wave), (_, strain) = replace(spectrum, p_value=1 / 201, n_skies=200).answer.lines
    assert wave.startswith("not decided")
    assert "more than on all 200 simulated skies; 370 are needed" in wave
    assert strain.startswith("< 2.4e-10 to 2.4e-10")
