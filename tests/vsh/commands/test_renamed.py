"""Options by the names of version 0.1 mean what they meant, in words and in a saved run.toml."""

import os
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT

from vsh.__main__ import import_command_module
from vsh.commands import parsing

#: What was said, and what is said now.
CASES = [
    ("fit c.fits --no-figures --dpi 100", "fit c.fits --format none --format @100"),
    ("fit c.fits --catalogue-frame galactic --sigma 3", "fit c.fits --columns frame=galactic,sigma=3"),
    ("fit c.fits --columns pmra=mu --input-format=mrt", "fit c.fits --columns pmra=mu,format=mrt"),
    ("fit --waves c.fits --years 2.8", "fit c.fits --waves 2.8"),
    ("fit --floor c.fits", "fit c.fits --floor yes"),
    ("fit c.fits --scheduler tcp://head:8786", "fit c.fits --workers tcp://head:8786"),
    ("compare a b --floor --by position --radius 2 --threshold 4", "compare a b --floor yes --match 2 --method clip=4"),
    ("compare a b --no-floor --position-error 200", "compare a b --floor no --columns sigma=200"),
    ("redshift g --h0 67 --h0-error 2 --posterior --n-samples 500", "redshift g --h0 67±2 --posterior 500"),
    ("redshift g --posterior --h0-range 40,90 --method grid", "redshift g --posterior --h0 40:90 --sampler grid"),
    ("redshift g --bins 3 --estimator student --no-floor", "redshift g --bins 3 --method student --floor no"),
    ("redshift g --velocity planck --no-flows --clip 5", "redshift g --velocity planck --flows no --method clip=5"),
    ("redshift g --h0 70 --flows --peculiar-dispersion 200", "redshift g --h0 70 --flows yes --dispersion 200"),
    ("redshift g --velocity planck --no-local-group", "redshift g --velocity planck --flows alone"),
    ("redshift g --h0 70 --reconstruction grid.npz", "redshift g --h0 70 --flows grid.npz"),
    ("sim galaxies --output o.fits --no-transits --flow linear --peculiar-dispersion 250",
     "sim galaxies --output o.fits --errors expected --flow linear,250"),
    ("sim epochs --output o.fits --attitude solved", "sim epochs --output o.fits --errors solved"),
]  # fmt: skip
#: What differs between two ways of saying one thing.
SAID = ("given", "command", "expected", "config")


def options_of(words):
    command, *arguments = words.split()
    found = vars(parsing.parse_options(import_command_module(command), arguments))
    return {name: value for name, value in found.items() if name not in SAID}


@pytest.mark.parametrize(("then", "now"), CASES, ids=[then for then, _ in CASES])
def test_old_words_mean_the_same(then, now):
    assert options_of(then) == options_of(now)


@pytest.mark.parametrize(
    ("command", "text", "now"),
    [
        ("fit", 'catalogue = "c.fits"\ncatalogue-frame = "galactic"\nsigma = 3\nno-figures = true\nfloor = true',
         "fit c.fits --columns frame=galactic,sigma=3 --format none --floor"),
        ("redshift", 'catalogue = "g"\nposterior = true\nh0 = 67\nh0-error = 2\nn-samples = 500',
         "redshift g --posterior 500 --h0 67±2"),
    ],
)  # fmt: skip
def test_saved_runs_are_read(command, text, now, tmp_path):
    path = tmp_path / "run.toml"
    path.write_text(f"[options]\n{text}\n", encoding="utf-8")
    assert options_of(f"{command} --config {path}") == options_of(now)


def test_settings_of_the_process(monkeypatch, tmp_path):
    assert (
        parsing.parse_options(import_command_module("fit"), ["c.fits", "--threads", "2", "--log", "x.log"]).log
        == "x.log"
    )
    monkeypatch.setenv("VSH_LOG", str(tmp_path / "run.log"))
    options = parsing.parse_options(import_command_module("fit"), ["c.fits"])
    assert (options.threads, options.log) == (None, os.environ["VSH_LOG"])


def test_what_went_says_where_it_is(capsys):
    with pytest.raises(SystemExit):
        parsing.parse_options(import_command_module("redshift"), ["g.fits", "--h0", "70", "--omega-m", "0.3"])
    assert "in Python: observer_velocity(cosmology=)" in capsys.readouterr().err


def test_plan_of_dr4_is_understood_word_for_word():
    plan = tomllib.loads(Path(ROOT, "docs", "dr4_plan.toml").read_text(encoding="utf-8"))
    for line in plan["commands"].values():
        program, *words = line.split()
        assert parsing.parse_options(import_command_module(program.removeprefix("vsh-")), words) is not None
