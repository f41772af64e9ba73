"""Templates: their fields, their amplitudes beside the systematic errors, and what is refused."""

import re

import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field

import fit
import sim
from fit.background import SHAPES, Template, cross_powers, floor, shared
from fit.commands.fit import main
from vsh import Coefficients, Field, Modes, ModesError, ParameterError, ScalarField, ScalarModes
from vsh.sky.pixels import centres

healpy = pytest.importorskip("healpy", reason="there is no healpy for Windows")
LON, LAT = centres(16)


def smooth(lon, lat):
    return np.cos(lat) ** 2 * np.cos(2 * lon) + np.sin(3 * lat)


MAP = smooth(LON, LAT)


def fields_of(template, lmax=5, frame="icrs"):
    return [Coefficients(Modes(lmax), each.values) for each in template.fields(Modes(lmax), frame)]


def test_map_moves_along_its_slope_and_across():
    along, across = fields_of(Template("scans", MAP))
    lon, lat = sim.uniform_sky(500, 1)
    step = 1e-5
    east = (smooth(lon + step, lat) - smooth(lon - step, lat)) / (2 * step) / np.cos(lat)
    north = (smooth(lon, lat + step) - smooth(lon, lat - step)) / (2 * step)
    motion = along.at(lon, lat)
    scale = np.sum(motion * [east, north]) / np.sum(motion**2)
    assert scale > 0
    np.testing.assert_allclose(scale * motion, [east, north], atol=1e-3 * np.std(north))
    turned = across.at(lon, lat)
    np.testing.assert_allclose(np.abs([turned[0], turned[1]]), np.abs([motion[1], motion[0]]), atol=1e-12)
    for each in (along, across):
        assert np.mean((each.at(LON, LAT) ** 2).sum(0)) == pytest.approx(1, rel=1e-3)


def test_maps_files_columns_and_coefficients_agree(tmp_path):
    healpy.write_map(tmp_path / "scans.fits", MAP, dtype=np.float64, coord="C")
    lon, lat = sim.uniform_sky(4000, 2)
    column = Template.of_sources("m", lon, lat, np.ma.masked_where(lon > 6.2, 7 * smooth(lon, lat) + 2))
    sources = (Template("m", MAP), Template("m", tmp_path / "scans.fits"), column)
    from_map, from_file, from_column = (fields_of(each)[0].values for each in sources)
    np.testing.assert_allclose(from_file, from_map, atol=1e-12)
    np.testing.assert_allclose(from_column, from_map, atol=1e-6)
    vector = Coefficients(Modes(5), from_map)
    np.testing.assert_allclose(fields_of(Template("m", 3.0 * vector))[0].values, from_map, atol=1e-12)
    turned = fields_of(Template("m", MAP), frame="galactic")[0]
    ours = Field(lon, lat, vector.at(lon, lat), np.ones((2, 4000))).to_frame("galactic")
    np.testing.assert_allclose(turned.at(ours.lon, ours.lat), ours.motion, atol=1e-6)


def skies(count, amplitude, template):
    """Skies with so much of a template along its slope."""
    lon, lat = sim.plane_avoiding_sky(3000, 3)
    pattern = fields_of(template, 12)[0].at(lon, lat)
    for seed in range(count):
        motion = 100 * np.random.default_rng([5, seed]).normal(size=(2, 3000)) + amplitude * pattern
        yield Field(lon, lat, motion, np.full((2, 3000), 100.0))


def fits(count, amplitude, template):
    equations = (fit.normal_equations(field, 5, templates=[template]) for field in skies(count, amplitude, template))
    return [shared([each], draws=100, rng=seed) for seed, each in enumerate(equations)]


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [3, 0, 10])
def test_amplitudes_come_back(sigma):
    """The mean of 24 amplitudes is the truth to .2 of one error and its own; errors are the scatter."""
    template = Template("scans", MAP)
    truth = sigma * float(np.sqrt(fits(1, 0.0, template)[0].amplitude_covariance[0, 0]))
    results = fits(24, truth, template)
    pulls = np.array([(each.amplitudes[0] - truth) / np.sqrt(each.amplitude_covariance[0, 0]) for each in results])
    assert abs(pulls.mean()) < 0.2 + 3 / np.sqrt(24)
    assert 0.6 < np.sqrt(np.mean(pulls**2)) < 1.35
    across = np.array([each.amplitudes[1] / np.sqrt(each.amplitude_covariance[1, 1]) for each in results])
    assert np.sqrt(np.mean(across**2)) < 1.35
    first = np.array([each.values[0] / np.sqrt(np.diag(each.covariance)) for each in results])
    assert 0.7 < np.sqrt(np.mean(first**2)) < 1.2


def test_numbers_follow_the_map_itself():
    """Amplitudes of a map in numbers come back within their errors, and the mean and dipole stay what they are."""
    template, (lon, lat) = Template("scans", MAP), sim.plane_avoiding_sky(3000, 3)
    (field,) = template.fields(ScalarModes(5), "icrs")
    values = smooth(lon, lat) - MAP.mean()
    pulls, means = [], []
    for seed in range(8):
        numbers = 7 + 40 * values / MAP.std() + 100 * np.random.default_rng([6, seed]).normal(size=3000)
        scalars = ScalarField(lon, lat, numbers, np.full(3000, 100.0), "µas")
        normal = fit.normal_equations(scalars, 5, templates=[template])
        result = shared([normal], draws=100, rng=seed)
        pulls.append((result.amplitudes[0] - 40) / np.sqrt(result.amplitude_covariance[0, 0]))
        means.append((result.solutions[0].mean[0] - 7) / result.solutions[0].mean[1])
        powers = cross_powers(fit.solve(fit.normal_equations(scalars, 5)), normal.templates)
        assert powers.unit == "µas"
        assert "µas/yr" not in str(powers)
    assert field.name == "scans"
    assert 0.2 < np.sqrt(np.mean(np.square(pulls))) < 1.8
    assert abs(np.mean(means)) < 1.2
    with pytest.raises(ParameterError, match="numbers do not follow"):
        Template("flow", Coefficients(Modes(5), np.ones(70))).fields(ScalarModes(5), "icrs")


def test_template_in_degree_one_is_taken_from_the_acceleration():
    """A density that leans to one pole moves motions in degree 1 too: without the template that is acceleration."""
    leaning = Template("lean", np.sin(LAT) + 0.8 * np.sin(2 * LAT) ** 2 * np.cos(LON) + np.sin(3 * LAT))
    right = [each.values[0, 3] / np.sqrt(each.covariance[3, 3]) for each in fits(6, 30.0, leaning)]
    plain, zonal = [fit.fit_field(field, 5) for field in skies(6, 30.0, leaning)], Modes(5).slice_of("S", 1).start
    biased = [solution.values[zonal] / solution.sigma[zonal] for solution in plain]
    assert abs(np.mean(biased)) > 3
    assert abs(np.mean(right)) < 1.5


def test_equations_with_templates_add(tmp_path):
    field, templates = random_field(2000, 4), [Template("scans", MAP)]
    whole = fit.normal_equations(field, 4, templates=templates)
    halves = [fit.normal_equations(part, 4, templates=templates) for part in (field[:900], field[900:])]
    both = halves[0] + halves[1]
    assert [each.name for each in both.templates] == ["scans, along", "scans, across"]
    np.testing.assert_allclose(both.matrix, whole.matrix, rtol=1e-12, atol=1e-9)
    one, two = (shared([each], draws=50) for each in (whole, both))
    np.testing.assert_allclose(one.amplitudes, two.amplitudes, rtol=1e-6)
    streamed = fit.normal_equations([field[:900], field[900:]], 4, templates=templates)
    np.testing.assert_allclose(shared([streamed], draws=50).amplitudes, one.amplitudes, rtol=1e-6)
    with pytest.raises(ModesError, match="with templates and without"):
        whole + fit.normal_equations(field, 4)
    with pytest.raises(ModesError, match="different templates"):
        whole + fit.normal_equations(field, 4, templates=[Template("other", MAP**2)])
    assert "templates are not in this fit" in "\n".join(fit.solve(whole).notes)
    with pytest.raises(ParameterError, match="shared"):
        floor(whole)
    with pytest.raises(ParameterError, match="different templates"):
        shared([whole, fit.normal_equations(field, 4)])


@pytest.mark.slow
def test_column_of_a_catalogue_in_parts(tmp_path, capsys):
    """Its means by pixel are the column: coefficients to 1e-3 of it, and what the command prints of it."""
    rng = np.random.default_rng(4)
    field = sim.observe(sim.quasars(30_000, 1), sim.spin((0, 0, 0)), 2, sigma=100.0)
    numbers = 20 + 3 * np.sin(2 * field.lon) * np.cos(field.lat) ** 2 + rng.normal(size=len(field))
    numbers[::1000] = np.nan
    one = Template.of_sources("scans", field.lon, field.lat, numbers)
    parts = [(field.lon[k::3], field.lat[k::3], numbers[k::3]) for k in range(3)]
    many = Template.of_parts("scans", iter(parts))
    for frame in ("icrs", "galactic"):
        for first, second in zip(one.fields(Modes(5), frame), many.fields(Modes(5), frame), strict=True):
            np.testing.assert_allclose(second.values, first.values, atol=1e-3 * np.abs(first.values).max())
    with pytest.raises(ParameterError, match="the template scans has no finite number"):
        Template.of_parts("scans", [(field.lon, field.lat, np.full(len(field), np.nan))])
    table = Table(field.to_table())
    table["scans"] = numbers
    table.write(tmp_path / "s.fits")
    tables = []
    for more in ([], ["--workers", "1"]):
        assert main([str(tmp_path / "s.fits"), "--lmax", "4", "--templates", "scans", "--format", "none", *more]) == 0
        tables.append(capsys.readouterr().out)
    lines = [next(line for line in text.splitlines() if line.startswith("template scans, across")) for text in tables]
    told = [[float(word) for word in re.findall(r"(?<!\S)[+-]?\d+(?:\.\d+)?(?!\S)", line)] for line in lines]
    assert told[0]
    np.testing.assert_allclose(*told, rtol=0.05, atol=0.02)


def test_templates_that_say_nothing_are_refused():
    field = random_field(300, 1)
    for templates, words in (
        ([Template("flat", np.ones(768))], "constant"),
        ([Template("a", MAP), Template("b", 2 * MAP + 5)], "are the same"),
        ([Template("half", np.where(LAT > -0.2, np.nan, MAP))], "no value in"),
    ):
        with pytest.raises(ParameterError, match=words):
            fit.normal_equations(field, 4, templates=templates)
    with pytest.raises(ParameterError, match="no HEALPix map"):
        Template("short", np.arange(5.0))
    cap = sim.uniform_sky(4000, 2)[1] > 1.2
    lon, lat = (each[cap] for each in sim.uniform_sky(4000, 2))
    with pytest.raises(ParameterError, match="too little of the sky"):
        fit.normal_equations(field, 5, templates=[Template.of_sources("cap", lon, lat, smooth(lon, lat))])
    with pytest.raises(ParameterError, match="degree of the solution"):
        cross_powers(fit.fit_field(field, 3), ())


def test_cross_powers_are_the_amplitude_by_degree():
    lon, lat = sim.uniform_sky(20000, 1)
    template = Template("scans", MAP)
    along = fields_of(template)[0]
    rng = np.random.default_rng(1)
    field = Field(lon, lat, 9.0 * along.at(lon, lat) + rng.normal(size=(2, 20000)) * 5, np.full((2, 20000), 5.0))
    solution = fit.fit_field(field, 5)
    powers = cross_powers(solution, template.fields(Modes(5), "icrs"), 4.0 * SHAPES["flat"])
    assert (powers.errors_with_floor > powers.errors).all()
    own = np.array([name == "scans, along" for name in powers.templates])
    size = np.sqrt(np.sum(powers.values[own] ** 2))
    assert size == pytest.approx(9.0, abs=3 * np.sqrt(np.sum(powers.errors[own] ** 2)))
    assert np.sqrt(np.mean((powers.values[~own] / powers.errors[~own]) ** 2)) < 2.0
    assert len(powers.to_table()) == len(powers.values)
    lines = powers.report().splitlines()
    assert len(lines) == len(powers.values) + 3
    assert lines[-1].startswith("More than three errors with the floor: ")
    listed = lines[-1].partition(". ")[0]
    assert "l = 2" in listed
    assert "l = 1" not in listed
    assert "across" not in listed
    first, second = powers.plot().get_legend().legend_handles  # both parts of a template: one colour, filled and not
    assert first.get_color() == second.get_color() == first.get_markerfacecolor()
    assert second.get_markerfacecolor() == "none"


def test_maps_of_a_mission_are_templates():
    maps = sim.scan_maps(sim.NominalScanningLaw(years=1.0), 4)
    assert len(maps) == 9
    assert maps["transits"].sum() > 192 * 5
    assert all(np.nanmax(np.abs(values)) <= 1 for name, values in maps.items() if name != "transits")
    normal = fit.normal_equations(random_field(500, 2), 4, templates=[Template("transits", maps["transits"])])
    assert len(shared([normal], draws=50).templates) == 2


@pytest.mark.slow
def test_command(tmp_path, capsys):
    field = random_field(3000, 6)
    table = field.to_table()
    table["scans"] = np.where(np.asarray(field.lat) > 1.4, np.nan, smooth(field.lon, field.lat))
    table.write(tmp_path / "q.fits")
    healpy.write_map(tmp_path / "m.fits", MAP + LAT**3, dtype=np.float64)
    fit.fit_field(random_field(3000, 7), 3).write(tmp_path / "stars.ecsv")
    names = f"scans,density,icrs:{tmp_path / 'm.fits'},{tmp_path / 'stars.ecsv'}"
    run = ["--lmax", "4", "--templates", names, "--output", str(tmp_path / "out")]
    assert main([str(tmp_path / "q.fits"), *run]) == 0
    text = capsys.readouterr().out
    for words in ("template scans, along", "template density, across", "template m.fits, along", "template stars.ecsv"):
        assert words in text
    assert {"cross_powers.ecsv", "cross_powers.png", "shared.ecsv"} <= {p.name for p in (tmp_path / "out").iterdir()}
    assert main([str(tmp_path / "q.fits"), "--lmax", "4", "--templates", "nothing"]) == 1
    assert "no such file, and no such column" in capsys.readouterr().err
    assert main([str(tmp_path / "q.fits"), "--lmax", "4", "--templates", "scans", "--classes", "halves:galactic"]) == 0
    assert "template scans, along" in capsys.readouterr().out
    capsys.readouterr()
    table = Table.read(tmp_path / "q.fits")["source_id", "ra", "dec"]
    table["phot_g_mean_mag"] = 18 + np.sin(np.radians(table["dec"]) * 3)
    table["parallax"], table["parallax_error"] = np.random.default_rng(4).normal(0, 0.1, len(table)), 0.1
    table.write(tmp_path / "parallaxes.fits")  # without motions
    scalars = [str(tmp_path / "parallaxes.fits"), "--value", "parallax", "--templates", "density,phot_g_mean_mag"]
    assert main([*scalars, "--lmax", "4"]) == 0
    assert "Values along each template" in capsys.readouterr().out
