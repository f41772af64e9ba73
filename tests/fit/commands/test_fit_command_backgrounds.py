import pytest
from conftest import real_catalogue

from fit.background import Floor, WaveLimit
from fit.commands.fit import main
from fit.results.storage import read

EVERYTHING = ["--demo", "--long", "--method", "least-squares", "--floor", "--waves", "--years", "10"]


@pytest.mark.slow
def test_floor_and_waves(tmp_path, capsys):
    out, page = tmp_path / "out", tmp_path / "page.html"
    assert main([*EVERYTHING, "--output", str(out), "--html", str(page)]) == 0
    text = capsys.readouterr().out
    for words in ("errors from    the catalogue times 1.", "with the systematic floor from degrees 2, 3 (spectra: flat ", "exact likelihood, flat in √Ω",
                  "coefficients flat: quantile", "f < 1/T = 3.17 nHz (T = 10 yr)", "that both parities have equal power"):  # fmt: skip
        assert words in text
    assert text.count("\nSystematic floor\n") == 1
    assert {"floor.ecsv", "waves.ecsv", "waves.png"} <= {each.name for each in out.iterdir()}
    found, limit = read(out / "floor.ecsv"), read(out / "waves.ecsv")
    assert isinstance(found, Floor)
    assert isinstance(limit, WaveLimit)
    solution = read(out / "solution.ecsv")
    assert solution.spin.sigma.min() > found.spin_error
    assert (out / "report.txt").read_text(encoding="utf-8").count("Gravitational waves longer") == 1
    html = page.read_text(encoding="utf-8")
    assert "95 % limits" in html
    assert "Systematic floor" in html


def test_floor_is_included_unasked(tmp_path, capsys):
    assert main(["--demo", "--format", "none", "--output", str(tmp_path / "out")]) == 0
    assert "systematic floor included (acceleration ±" in capsys.readouterr().out
    assert isinstance(read(tmp_path / "out" / "floor.ecsv"), Floor)
    assert main(["--demo", "--method", "least-squares"]) == 0
    assert "systematic floor" not in capsys.readouterr().out


@pytest.mark.parametrize(("options", "words"), [
    (["--method", "student", "--floor", "--lmax", "2"], "degree 2 cannot determine a systematic floor: use --lmax 3 or higher"),
    (["--waves", "--lmax", "1"], "gravitational waves begin at degree 2: take --lmax 2 or higher"),
])  # fmt: skip
def test_messages(options, words, capsys):
    assert main(["--demo", *options]) == 1
    assert words in capsys.readouterr().err


def test_with_clipping_and_robust_fits(capsys):
    path = str(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    for options in ("clip=3", "student", "excess-noise", "jackknife=2"):
        assert main([path, "--floor", "--long", "--method", options]) == 0
        text = capsys.readouterr().out
        assert "with the systematic floor from degrees 2, 3" in text
    assert main([path, "--method", "least-squares", "--lmax", "2", "--waves", "--years", "22.6", "--long"]) == 0
    text = capsys.readouterr().out
    for number in ("0.03571", "0.02703", "0.02295", "1.4 nHz"):
        assert number in text
