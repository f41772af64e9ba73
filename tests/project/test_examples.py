"""The examples are tutorials and tests: each runs, prints what it should and draws its figure.

Those that take long are slow tests; all of them run when the documentation is built.
"""

import re

import pytest
from conftest import ROOT, real_catalogue, run_python


def run(name, *arguments, folder, figures=()):
    """What an example prints; its figures have something on them."""
    done = run_python("-W", "error:::__main__", ROOT / "examples" / name, *arguments, folder=folder)
    for each in figures:
        assert (folder / f"{each}.png").stat().st_size > 10_000, each
    return done.stdout


def pulls_of(text):
    return [float(x) for line in text.splitlines() if "found − true" in line for x in line.split("[")[1][:-1].split()]


@pytest.mark.slow
def test_first_fit(tmp_path):
    text = run("first_fit.py", folder=tmp_path, figures=["first_fit"])
    pulls = pulls_of(text)
    assert len(pulls) == 6
    assert max(map(abs, pulls)) < 3


@pytest.mark.slow
def test_skies_in_place_of_a_likelihood(tmp_path):
    text = run("skies_in_place_of_a_likelihood.py", folder=tmp_path)
    for value, error, true in re.findall(r" (\S+) ± (\S+)   truth (\S+)", text):
        assert abs(float(value) - float(true)) < 3 * float(error)
    assert text.count("truth") == 4


@pytest.mark.slow
def test_real_catalogue_on_the_demo(tmp_path):
    text = run("real_catalogue.py", ROOT / "fit" / "demo.fits", folder=tmp_path, figures=["real_catalogue"])
    assert "acceleration 5." in text or "acceleration 4." in text


@pytest.mark.slow
def test_real_catalogue(tmp_path):
    text = run("real_catalogue.py", real_catalogue("td2017_vlba_proper_motions.ecsv"), folder=tmp_path)
    assert "clipped 68 of 713" in text


@pytest.mark.slow
def test_robust_fits(tmp_path):
    """On the gallery's twin of a catalogue whose errors are wrong: least squares is off by many of its errors, the others by few of theirs."""
    run("make_vlbi_twin.py", tmp_path / "twin.ecsv", folder=tmp_path)
    text = run("robust_fits.py", tmp_path / "twin.ecsv", folder=tmp_path, figures=["robust_fits"])
    rows = [line.split() for line in text.replace("°", "").splitlines()[1:]]
    away = [float(row[-1]) for row in rows]  # degrees from the Galactic centre, where the truth points
    assert len(rows) == 5
    assert away[0] > 30
    assert max(away[1:]) < 15
    errors = [float(re.search(r"± (\S+)", line)[1]) for line in text.splitlines()[1:]]
    assert min(errors[3:]) > 3 * errors[0]


@pytest.mark.slow
def test_simulated_sky(tmp_path):
    text = run("simulated_sky.py", folder=tmp_path)
    assert "gums: ã = " in text
    figures = {
        f"{name}.png" for name in ["density_gums", "density_igql", "transits", "tracks", "galaxies", "simulated_sky"]
    }
    assert {path.name for path in tmp_path.glob("*.png")} == figures


@pytest.mark.slow
def test_redshift_dipoles(tmp_path):
    text = run("redshift_dipoles.py", folder=tmp_path, figures=["redshift_dipoles"])
    numbers = [
        [float(each.split(": ")[-1].removeprefix("p-value ")) for each in line.split(";")]
        for line in text.splitlines()[-2:]
    ]
    (spin, _, true), (_, _, claimed) = numbers
    assert spin > 0.003
    assert true > 0.003
    assert claimed < 1e-6  # what is true, contradicted: without the flow in the errors


@pytest.mark.slow
def test_velocity_or_hubble(tmp_path):
    text = run("velocity_or_hubble.py", folder=tmp_path, figures=["velocity_or_hubble"])
    pulls = pulls_of(text)
    assert len(pulls) == 4
    assert max(map(abs, pulls)) < 3.5
    lines = [line.split() for line in text.splitlines() if line.startswith(("H0 from the chain", "H0 on a grid"))]
    (chain, _), (mean, sigma) = ((float(words[4]), float(words[6])) for words in lines)
    assert abs(mean - chain) < 0.05 * sigma
    assert abs(mean - 70) < 3.5 * sigma


@pytest.mark.slow
def test_velocity_forecast(tmp_path):
    text = run("velocity_forecast.py", folder=tmp_path, figures=["velocity_forecast"])
    lines = [line.split() for line in text.splitlines() if line.strip().startswith("DR")]
    rows = {tuple(words[:2]): words[3:] for words in lines}
    assert len(rows) == 9
    independent, flows = (float(rows["DR5", "0.03"][i]) for i in (0, 2))
    assert flows > 3 * independent
    pulls = {
        line.split()[0]: max(abs(float(x)) for x in line.split("[")[1][:-1].split())
        for line in text.splitlines()
        if "found − true" in line
    }
    assert pulls["flows"] < 3.5


@pytest.mark.slow
def test_correlation_matrices(tmp_path):
    text = run("correlation_matrices.py", folder=tmp_path, figures=["correlation_matrices", "influence"])
    assert re.search(r"above diagonal +GUMS-like\nbelow diagonal +IGQL-like", text)
    assert "half of the northern cap: errors of the acceleration" in text


@pytest.mark.slow
def test_compare_catalogues(tmp_path):
    text = run("compare_catalogues.py", folder=tmp_path)
    rows = [line.split() for line in text.splitlines() if " truth " in line]
    assert len(rows) == 16
    assert max(abs(float(row[1]) - float(row[4])) / float(row[2]) for row in rows) < 3.5
    assert "unmatched: 100 of 3000 and 0 of 2900" in text


@pytest.mark.slow
def test_compare_real_catalogues(tmp_path):
    paths = [real_catalogue(name) for name in ("icrf3sx.txt", "icrf2-all.txt")]
    text = run("compare_catalogues.py", *paths, folder=tmp_path)
    assert "matched 3410 sources by name; unmatched: 1126 of 4536 and 4 of 3414" in text
    assert "1936+095" in text


@pytest.mark.slow
def test_parallax_zero_point(tmp_path):
    text = run("parallax_zero_point.py", folder=tmp_path, figures=["parallax_zero_point"])
    assert float(text.split("rms ")[1].split(",")[0]) < 1.3


@pytest.mark.slow
def test_pairs_and_waves(tmp_path):
    text = run("pairs_and_waves.py", folder=tmp_path)
    assert float(text.split("one wave: ")[1].split("°")[0]) < 25
    assert {x.name for x in tmp_path.glob("*.png")} == {"pairs.png", "one_wave.png"}


@pytest.mark.slow
def test_harmonics(tmp_path):
    run("harmonics.py", folder=tmp_path, figures=["harmonics_1", "harmonics_2"])


@pytest.mark.slow
def test_shared_errors(tmp_path):
    """With a thousand times the sources, what a plain fit quotes is a tenth of the truth; with the floor it is the truth."""
    text = run("shared_errors.py", folder=tmp_path, figures=["shared_errors"])
    _, plain_true, plain_quoted, true, quoted = map(float, text.splitlines()[-1].split())
    assert plain_quoted < 0.2 * plain_true
    assert 0.75 < quoted / true < 1.3


@pytest.mark.slow
def test_joint_solution(tmp_path):
    text = run("joint_solution.py", folder=tmp_path, figures=["joint_solution", "joint_convergence", "joint_errors"])
    assert "10.0: 1.0," in text
    assert 1.7 < float(re.search(r"solved from the quasars alone: (\S+)", text)[1]) < 2.3


@pytest.mark.slow
def test_pulsars_and_motions(tmp_path):
    assert "motions and pulsars: Ω from 0.36 to 0.52 (68 %), 0.4 is true" in run(
        "pulsars_and_motions.py", folder=tmp_path, figures=["overlap_functions", "pulsars_and_motions"]
    )


@pytest.mark.slow
def test_growth_from_motions(tmp_path):
    text = run("growth_from_motions.py", folder=tmp_path, figures=["growth_flow"])
    assert abs(float(re.search(r"f/b (\S+) ± ", text)[1]) - 0.526) < 0.6


@pytest.mark.slow
def test_calibrated_basic_angle(tmp_path):
    text = run("calibrated_basic_angle.py", folder=tmp_path, figures=["calibrated_basic_angle"])
    median = [float(each) for each in re.findall(r"(\S+) \(median\)", text)]
    assert median == pytest.approx([0.82, 0.82, 0.77, 0.64, 0.64, 0.18], abs=0.03)


@pytest.mark.slow
def test_vlbi_backgrounds(tmp_path):
    text = run("vlbi_backgrounds.py", ROOT / "fit" / "demo.fits", folder=tmp_path, figures=["vlbi_waves"])
    assert "systematic floor included (acceleration ±" in text
    assert "f < 1/T = 1.4 nHz" in text


@pytest.mark.slow
def test_vlbi_backgrounds_of_the_table(tmp_path):
    text = run("vlbi_backgrounds.py", real_catalogue("td2017_vlba_proper_motions.ecsv"), folder=tmp_path)
    for number in ("0.03571", "0.02703", "0.02295", "28.546"):
        assert number in text


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "tutorials").glob("*.py")), ids=lambda path: path.stem)
def test_tutorials(path, tmp_path):
    run_python(path, folder=tmp_path)
    assert list(tmp_path.iterdir()) == []
