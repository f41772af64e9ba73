"""A run writes the file that repeats it."""

import tomllib

import pytest
from astropy.table import Table

import fit.results.storage
from fit.commands import compare, redshift
from fit.commands import correlate as correlate_words
from fit.commands import fit as options_module
from fit.commands.correlate import main as correlate
from fit.commands.fit import main
from sim.commands.simulate import main as simulate
from vsh.commands import parsing


@pytest.fixture
def catalogue(tmp_path):
    path = tmp_path / "c.fits"
    assert simulate(["quasars", "--number", "400", "--errors", "expected", "--output", str(path), "--quiet"]) == 0
    return str(path)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.slow
def test_configuration_repeats_the_run_to_the_byte(catalogue, tmp_path):
    """Report, tables, figures, provenance, citations, and the configuration itself."""
    first = [catalogue, "--lmax", "2", "--method=clip=4", "--frame", "galactic"]
    assert main([*first, "--where", "pmra_error < 3 and ra > 1.5", "--output", str(tmp_path / "a")]) == 0
    made = tomllib.loads((tmp_path / "a" / "run.toml").read_text(encoding="utf-8"))
    assert made["command"] == "vsh-fit"
    assert made["options"] == {
        "catalogue": catalogue, "lmax": 2, "method": "clip=4", "frame": "galactic", "where": "pmra_error < 3 and ra > 1.5",
    }  # fmt: skip
    assert len(made["files"]["c.fits"]) == 64
    assert main(["--config", str(tmp_path / "a" / "run.toml"), "--output", str(tmp_path / "b")]) == 0
    assert contents(tmp_path / "b") == contents(tmp_path / "a")


def test_command_line_takes_precedence(catalogue, tmp_path):
    assert main(f"{catalogue} --lmax 2 --method clip=4 --output {tmp_path / 'a'} --format none".split()) == 0
    config = ["--config", str(tmp_path / "a" / "run.toml")]
    assert main([*config, "--lmax", "1", "--method", "clip=9", "--output", str(tmp_path / "b")]) == 0
    made = tomllib.loads((tmp_path / "b" / "run.toml").read_text(encoding="utf-8"))["options"]
    assert made == {"lmax": 1, "method": "clip=9", "catalogue": catalogue, "format": "none"}
    assert fit.storage.read(tmp_path / "b" / "solution.ecsv").modes.lmax == 1


def test_command_line_takes_precedence_over_what_excludes_it(tmp_path):
    """A file that asks for the floor, and words that ask for none: the words; and of two ways to print, the last."""
    path = tmp_path / "run.toml"
    path.write_text('[options]\ncatalogue = "a.fits"\ncatalogue2 = "b.fits"\nfloor = true\nlong = true\n')
    options = parsing.parse_options(compare, ["--config", str(path), "--floor", "no", "--quiet"])
    assert (options.floor, options.long, options.quiet) == ("no", False, True)


@pytest.mark.slow
def test_simulations_too(tmp_path):
    """A table has its configuration beside it."""
    asked = ["galaxies", "--number", "50", "--errors", "expected", "--velocity", "369,264,-48.5", "--spin", "-1,0,2"]
    assert simulate([*asked, "--seed", "3", "--output", str(tmp_path / "a.ecsv")]) == 0
    again = ["--config", str(tmp_path / "a.ecsv.run.toml"), "--output", str(tmp_path / "b.ecsv")]
    assert simulate(again) == 0
    assert (tmp_path / "a.ecsv").read_bytes() == (tmp_path / "b.ecsv").read_bytes()
    assert simulate(again) == 1  # both are there
    assert simulate([*again, "--overwrite"]) == 0


def test_options_that_come_several_times(catalogue, tmp_path):
    asked = [catalogue, "--influence", "omega_x,a_y", "--influence", "a_z", "--format", "none"]
    assert correlate([*asked, "--output", str(tmp_path / "a")]) == 0
    assert correlate(["--config", str(tmp_path / "a" / "run.toml"), "--output", str(tmp_path / "b")]) == 0
    assert contents(tmp_path / "b") == contents(tmp_path / "a")


CASES = [
    (options_module, ["c.fits", "--method", "jackknife"], {"catalogue": "c.fits", "method": "jackknife"}),
    (options_module, ["c.fits", "--method=jackknife=4"], {"catalogue": "c.fits", "method": "jackknife=4"}),
    (options_module, ["c.fits", "--columns", "pmra=mu,z=zsp", "--format", "pdf@1e2"], {"catalogue": "c.fits", "columns": "pmra=mu,z=zsp", "format": "pdf@1e2"}),
    (options_module, ["--demo"], {"demo": True}),
    (options_module, ["c.fits", "--where", 'name == "a\\b"'], {"catalogue": "c.fits", "where": 'name == "a\\b"'}),
    (options_module, ["c.fits", "--where", "x > 1\ny\x7f"], {"catalogue": "c.fits", "where": "x > 1\ny\x7f"}),
    (redshift, ["g.fits", "--h0", "67.40", "--redshift-frame", "true"], {"catalogue": "g.fits", "h0": "67.40", "redshift-frame": "true"}),
    (correlate_words, ["a", "b", "--influence", "x", "--influence", "y,z"], {"catalogue": "a", "catalogue2": "b", "influence": ("x", "y,z")}),
]  # fmt: skip


#: What differs between what is said and what a file says.
OURS = ("given", "command", "config")


@pytest.mark.parametrize(("module", "said", "wanted"), CASES, ids=str)
def test_from_words_to_a_file_and_back(module, said, wanted, tmp_path):
    options = parsing.parse_options(module, said)
    assert options.given == wanted
    path = tmp_path / "run.toml"
    path.write_text(parsing.Configuration(options.program, options.given).as_toml(), encoding="utf-8")
    again = parsing.parse_options(module, ["--config", str(path)])
    assert again.given == wanted | {"config": str(path)}
    one, two = ({k: v for k, v in vars(each).items() if k not in OURS} for each in (again, options))
    assert one == two


def test_written_by_hand(tmp_path):
    """Arrays and tables where the options_module have commas."""
    path = tmp_path / "mine.toml"
    path.write_text('[options]\ncatalogue = "g.fits"\nbins = [0.001, 0.010]\nh0 = 70\ncolumns = {redshift = "zq"}\n')
    options = parsing.parse_options(redshift, ["--config", str(path)])
    assert options.bins == (0.001, 0.01)
    assert options.h0 == 70
    assert options.columns == {"redshift": "zq"}


@pytest.mark.parametrize(("text", "words_of_it"), [
    ("lmax = 3", "lmax? A configuration has command, version, [options], [files]"),
    ("options = 3", "options and files? A configuration"),
    ("[options]\nlmaxx = 3", "vsh-fit has no option 'lmaxx'; nearest: lmax"),
    ("[options]\nlmax = 0", "a whole number of at least 1 is expected, not '0'"),
    ("[options]\nlmax = false", "lmax is text, a number, true, or several of them, not False"),
    ("[options]\nconfig = 'x.toml'", "no option 'config'"),
    ("[options]\nwhen = 2020-01-01", "when is text, a number"),
    ('command = "vsh-sim"\n[options]', "is a configuration of vsh-sim, not of vsh-fit"),
    ("[options", "is no TOML file"),
    ("\x00\xff", "is no TOML file"),
    (None, "No such file"),
])  # fmt: skip
def test_configurations_with_errors(text, words_of_it, tmp_path, capsys):
    path = tmp_path / "run.toml"
    if text is not None:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(SystemExit) as end:
        parsing.parse_options(options_module, ["c.fits", "--config", str(path)])
    assert end.value.code == 2
    assert words_of_it in capsys.readouterr().err


def test_shortened_option_is_seen(tmp_path):
    path = tmp_path / "run.toml"
    path.write_text("[options]\ndemo = true\nlmax = 2\n")
    assert parsing.parse_options(options_module, ["--conf", str(path)]).lmax == 2


def test_another_file_under_the_name_is_told(catalogue, tmp_path, capsys):
    assert main([catalogue, "--output", str(tmp_path / "a"), "--format", "none"]) == 0
    table = Table.read(catalogue)
    table["pmra"] += 1
    table.write(catalogue, overwrite=True)
    capsys.readouterr()
    assert main(["--config", str(tmp_path / "a" / "run.toml"), "--lmax", "1"]) == 0
    assert "note: c.fits is not the file that the configuration was written for" in capsys.readouterr().err
