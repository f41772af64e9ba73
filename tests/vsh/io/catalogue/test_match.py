import re
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field, real_catalogue

import fit
import sim
from fit.commands.compare import main as compare_command
from vsh import Coefficients, Modes
from vsh.conventions import to_icrf3
from vsh.io.catalogue import match, read_icrf, read_positions, rename_sources
from vsh.sky.frames import Positions
from vsh.tools.errors import FieldError, FrameError, TableError
from vsh.tools.units import UAS

LINES = """Some catalogue of positions

ICRF J000020.3-322101    2357-326       00 00 20.39997606    -32 21 01.2337415     0.00000804     0.0002624 -0.0602   56559.8
ICRF J000435.6-473619    0002-478  D    00 04 35.65548526    -00 36 19.6040054     0.00000655     0.0001076  0.2307   55601.6
ICRF J120435.7+201942    1202+200       12 04 35.75828557     20 19 42.3177240     0.00000638     0.0001418 -0.0807   55620.3
"""


def positions(n=500, seed=1, names=True):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    sigma = rng.uniform(50, 500, (2, n))
    name = np.array([f"Q{i}" for i in range(n)]) if names else None
    return Positions(lon, lat, sigma, rng.uniform(-0.8, 0.8, n), name)


def moved(catalogue, offset):
    """The same sources elsewhere: offsets (2, n) in µas, b = a − offset."""
    return Positions(
        catalogue.lon - offset[0] * UAS / np.cos(catalogue.lat), catalogue.lat - offset[1] * UAS, catalogue.sigma,
        catalogue.rho, catalogue.name,
    )  # fmt: skip


@pytest.mark.parametrize("by", ["name", "position"])
def test_offsets_come_out(by):
    a = positions()
    offset = Coefficients(Modes(2), np.arange(16.0)).at(a.lon, a.lat)
    order = np.random.default_rng(2).permutation(len(a))
    field = match(a, moved(a, offset)[order], by=by)
    assert len(field) == 500
    np.testing.assert_allclose(field.motion, offset, atol=2e-3)  # rounding: 1e-16 rad twice, times 2π
    np.testing.assert_allclose(field.sigma, np.sqrt(2) * a.sigma)
    np.testing.assert_allclose(field.rho, a.rho)
    assert (field.name == a.name).all()
    np.testing.assert_allclose(fit.fit_field(field, 2).coefficients.values, np.arange(16.0), atol=1e-3)


@pytest.mark.parametrize(("error", "doubt"), [(0.2, None), (2e5, "above 2e+05 mas"), (2e-9, "below 2e-09 mas")])
def test_errors_of_positions_without_a_unit_are_doubted_where_no_list_has_them(error, doubt, tmp_path):
    columns = {"ra": np.linspace(1, 300, 9), "dec": np.linspace(-40, 50, 9), "ra_error": np.full(9, error)}
    Table(columns | {"dec_error": np.full(9, error)}).write(tmp_path / "bare.csv")
    notes = [str(note) for note in read_positions(tmp_path / "bare.csv").notes if "half of the errors" in note]
    assert len(notes) == (doubt is not None)
    assert all(f"half of the errors are {doubt}" in note for note in notes)


def test_unmatched_and_ambiguous_sources_are_counted():
    a, b = positions(), positions()
    b = replace(b, name=np.where(np.arange(len(b)) < 3, "Q7", b.name))  # four of that name now
    field = match(a, b[:400])
    (note,) = (
        note for note in field.notes if note.startswith("matched 396 sources by name; unmatched: 104 of 500 and")
    )
    assert re.search("and 4 of 400 .*, 4 of them with several counterparts$", note)
    columns = (getattr(a, name) for name in ("lon", "lat", "sigma"))
    twin = Positions(*(np.concatenate([each, each[..., :2]], axis=-1) for each in columns))
    field = match(a, twin, by="position", radius=0.1)
    assert len(field) == 498
    assert "6 of them with several counterparts" in field.notes[-1]


def test_pairs_too_far_apart_are_remarked():
    a = positions()
    offset = np.zeros((2, 500))
    offset[1, 3] = 5e6
    assert "1 of the pairs are more than 1 arcsec apart (" in match(a, moved(a, offset)).notes[-1]
    assert len(match(a, moved(a, offset), by="position")) == 499


def test_many_pairs_far_apart_are_refused():
    """Positions that were misread gave a rotation of seventeen errors, and a word in the last line."""
    a = positions()
    offset = np.zeros((2, 500))
    offset[1, :50] = 5e6
    with pytest.raises(FieldError, match=r"50 of 500 pairs of one name .* \(Q0 for one\): other sources"):
        match(a, moved(a, offset))
    assert len(match(a, moved(a, offset), by="position")) == 450


def test_positions_are_carried_to_a_common_epoch():
    a = positions()
    motion = np.full((2, 500), 3000.0)
    a = Positions(a.lon, a.lat, a.sigma, a.rho, a.name, epoch=2016.0)
    past = moved(a, motion * 10)
    past = Positions(past.lon, past.lat, past.sigma, past.rho, past.name, motion=motion, epoch=2006.0)
    inner = np.abs(np.degrees(a.lat)) < 80
    np.testing.assert_allclose(match(a, past).motion[:, inner], 0, atol=0.05)
    assert np.abs(match(a, past.at_epoch(2006.0)).motion).max() < 1000
    with pytest.raises(FieldError, match="no epoch"):
        match(a, Positions(past.lon, past.lat, past.sigma, motion=motion), by="position")


def test_motions_are_compared_too():
    a, b = random_field(100, 1), random_field(100, 1)
    b = b._derive(motion=b.motion - 5.0, sigma=2 * b.sigma)
    field = match(a, b, by="position")
    np.testing.assert_allclose(field.motion, 5.0)
    np.testing.assert_allclose(field.sigma, np.sqrt(5) * a.sigma)
    np.testing.assert_allclose(field.rho, a.rho)


@pytest.mark.parametrize(("call", "error", "words"), [
    (lambda a: match(a, random_field(5, 1)), FieldError, "match Positions or Fields"),
    (lambda a: match(a, a, by="nearest"), FieldError, 'by "name" or "position"'),
    (lambda a: match(a, positions(names=False)), FieldError, "column of names"),
    (lambda a: match(a, a, by="position", radius=0), FieldError, "above zero"),
    (lambda a: match(a, positions(seed=2), by="position"), TableError, "the catalogues have no source in common"),
    (lambda a: match(random_field(5, 1), random_field(5, 1, frame="galactic")), FrameError, "icrs and galactic"),
    (lambda a: Positions(a.lon, a.lat, -a.sigma), FieldError, "σ ≤ 0: 500"),
    (lambda a: Positions(a.lon, a.lat + 5, a.sigma), FieldError, r"\|dec\| > 90°"),
])  # fmt: skip
def test_bad_input(call, error, words):
    with pytest.raises(error, match=words):
        call(positions())


def test_names_of_two_kinds():
    a = positions()
    b = Positions(a.lon, a.lat, a.sigma, name=np.arange(500))
    with pytest.raises(FieldError, match="are never equal, Q0 and 0 say: by="):
        match(a, b)


def test_layout_of_the_iers(tmp_path):
    path = tmp_path / "icrf.txt"
    path.write_text(LINES)
    found = read_icrf(path)
    assert list(found.name) == ["J000020.3-322101", "J000435.6-473619", "J120435.7+201942"]
    assert list(found.defining) == [False, True, False]
    np.testing.assert_allclose(np.degrees(found.lon), [20.39997606 / 240, 275.65548526 / 240, 180 + 275.75828557 / 240])
    np.testing.assert_allclose(np.degrees(found.lat)[1], -(36 / 60 + 19.6040054 / 3600))  # −00°
    np.testing.assert_allclose(found.sigma[:, 0], [8.04 * 15 * np.cos(found.lat[0]), 262.4])
    assert list(read_icrf(path, "iers").name) == ["2357-326", "0002-478", "1202+200"]


@pytest.mark.parametrize(("change", "words"), [
    (lambda t: t.replace("20.39997606", "x"), "line 3 is damaged: 'ICRF J000020.3-322101"),
    (lambda t: t.replace("0.0002624 -0.0602   56559.8", ""), "line 3 is damaged"),
    (lambda t: t.rstrip().removesuffix("0807   55620.3"), "line 5 is damaged: the list ends within it"),
    (lambda t: t.replace("0.0001076", "-0.000001"), "line 4 has no usable errors"),
    (lambda t: t.replace("ICRF J", "QUASAR "), "without a designation of the ICRF: name them by iers"),
    (lambda t: t.replace("ICRF J000435", "I?RF J000435"), "line 4 .* does not begin with 'ICRF J'"),
    (lambda t: t.replace("00 00 20.3", "00 00 203"), "line 3 .*no position"),
    (lambda t: t.replace("-32 21", "-92 21"), "line 3 .*no position"),
    (lambda t: t.replace("00 00 20", "25 00 20"), "line 3 .*no position"),
    (lambda t: "No rows\nat all\n", "no line with a position in hours and degrees"),
])  # fmt: skip
def test_damaged_catalogues(change, words, tmp_path):
    path = tmp_path / "icrf.txt"
    path.write_text(change(LINES))
    with pytest.raises(TableError, match=words):
        read_icrf(path)
    with pytest.raises(TableError, match="no such file"):
        read_icrf(tmp_path / "none.txt")
    with pytest.raises(TableError, match="icrf or iers"):
        read_icrf(path, "b1950")


def test_icrf3_against_icrf2():
    """ICRF3 − ICRF2: the axes agree to 20 µas; a glide of 60 to 100 µas southward, as the ICRF3 paper has it."""
    a, b = (read_icrf(real_catalogue(name), "iers") for name in ("icrf3sx.txt", "icrf2-all.txt"))
    assert (len(a), len(b), a.defining.sum(), b.defining.sum()) == (4536, 3414, 303, 295)
    field = match(a, b)
    assert "matched 3410 sources by name; unmatched: 1126 of 4536 and 4 of 3414" in "\n".join(field.notes)
    clipped = fit.robust.clip(field, Modes(2), threshold=5)
    found = to_icrf3(clipped.solution.coefficients)
    assert max(abs(found[name]) for name in ("R1", "R2", "R3")) < 20
    assert -110 < found["D3"] < -80
    assert 35 < found["E20"] < 65
    assert len(match(a, b, by="position")) == 3408


def test_motions_of_one_name_in_two_places_are_no_pair():
    """Running numbers of two lists are equal, and their sources are not; a century of motion is allowed for."""
    one, other = (replace(random_field(400, seed), name=np.arange(400)) for seed in (1, 2))
    with pytest.raises(FieldError, match="400 of 400 pairs of one name are more than 1 arcsec apart"):
        match(one, other)
    lat = np.array(one.lat)
    lat[7] += 5e6 * UAS
    assert "1 of the pairs are more than 1 arcsec apart (" in match(one, replace(one, lat=lat)).notes[-1]
    motion = np.array(one.motion)
    motion[1, 7] = 2e5  # 20 arcsec in a century
    assert "apart" not in match(replace(one, motion=motion), replace(one, lat=lat, motion=motion)).notes[-1]


def test_a_crosswalk_gives_the_names_of_another_release(tmp_path, capsys):
    """By dr3_neighbourhood: the nearest of several neighbours, and no source for two."""
    from fit.commands.compare import main

    quasars = sim.quasars(300, 1)
    one, two = (sim.observe(quasars, sim.spin((0, 0, spin)), 5 + spin, sigma=50.0) for spin in (0, 40))
    names = np.arange(300) + 10**6
    replace(one, name=names).write(tmp_path / "dr4.ecsv")
    replace(two, name=np.roll(names, 7) * 3).write(tmp_path / "dr3.ecsv")
    rows = [(3 * old, new, 0.1) for old, new in zip(np.roll(names, 7), names, strict=True)]
    rows += [(rows[5][0], rows[6][1], 0.9), (rows[9][0], rows[10][1], 0.01)]  # a farther one; and one that is taken
    Table(rows=rows, names=("dr3_source_id", "dr4_source_id", "angular_distance")).write(tmp_path / "n.ecsv")
    paths = [str(tmp_path / "dr4.ecsv"), str(tmp_path / "dr3.ecsv")]
    assert main([*paths, "--lmax", "1", "--crosswalk", str(tmp_path / "n.ecsv")]) == 0
    said = capsys.readouterr().out
    assert "298" in said
    assert re.search(r"rotation +[345]\d\.", said)
    assert main([*paths, "--lmax", "1"]) == 1  # without it nothing has a common name
    with pytest.raises(TableError, match="no crosswalk"):
        rename_sources(replace(two, name=np.arange(300)), Table({"dr3_source_id": [1]}))
    with pytest.raises(TableError, match="neither dr3_source_id nor dr4_source_id"):
        rename_sources(replace(two, name=np.arange(300)), tmp_path / "n.ecsv")


def test_link_and_comparison_name_sources_of_a_list_alike():
    """One by IERS names, the other by ICRF designations: the same file matched itself nowhere."""
    from vsh.io.astrometry import read_astrometry

    path = real_catalogue("icrf3sx.txt")
    assert set(read_astrometry(path, epoch=2015.0, still=True).name) == set(read_positions(path).name)


def test_offsets_of_positions_have_their_unit():
    """They were µas/yr in fits, tables and reports, and compared with the acceleration of Gaia."""
    field = random_field(50, 1)
    a, b = (
        Positions(field.lon + shift, field.lat, np.full((2, 50), 100.0), np.zeros(50), np.arange(50))
        for shift in (1e-9, 0)
    )
    offsets = match(a, b)
    assert offsets.unit == offsets[:9].unit == fit.fit_field(offsets, 1).spin.unit == "µas"
    table = offsets.to_table()
    assert table["dra"].unit == table["ddec_error"].unit == "mas"
    assert "pmra" not in table.colnames
    assert match(field._derive(name=np.arange(50)), field._derive(name=np.arange(50))).unit == "µas/yr"


def test_identifiers_that_are_digits_as_text_in_one_list():
    a = replace(positions(40), name=np.arange(40) + 10**18)
    b = replace(positions(40)[::-1], name=np.array([f" {k}" for k in (np.arange(40) + 10**18)[::-1]]))
    field = match(a, b)
    assert len(field) == 40
    np.testing.assert_allclose(field.motion, 0.0, atol=1e-3)


def test_galactic_lists_are_compared_as_icrs_ones(tmp_path, capsys):
    """Lists that state Galactic axes, or have l and b, were read as ICRS: another direction without a word."""
    icrs = [positions(300), moved(positions(300), Coefficients(Modes(1), np.arange(6.0) * 100).at(*_place(300)))]
    lines = []
    for frame, names in (("icrs", ("ra", "dec")), ("galactic", ("ra", "dec")), ("galactic", ("l", "b"))):
        paths = [tmp_path / f"{frame}_{names[0]}_{k}.ecsv" for k in "ab"]
        for path, catalogue in zip(paths, icrs, strict=True):
            turned = catalogue.to_frame(frame)
            axes = dict(zip(names, np.degrees([turned.lon, turned.lat]), strict=True))
            errors = dict(zip(("ra_error", "dec_error"), turned.sigma * 1e-3, strict=True))
            table = Table({"source_name": turned.name, **axes, **errors, "ra_dec_corr": turned.rho})
            table.meta = {"FRAME": frame} if names[0] == "ra" else {}
            table.write(path)
        columns = [] if names[0] == "ra" else ["--columns", "ra=l,dec=b"]
        assert compare_command([*map(str, paths), "--lmax", "1", *columns]) == 0
        lines.append(capsys.readouterr().out.split("errors")[0])
        read = read_positions(paths[0], dict(zip(("ra", "dec"), names, strict=True)))
        assert read.frame == frame
        again = read.to_frame("icrs")
        for name in ("lon", "lat", "sigma", "rho"):
            np.testing.assert_allclose(getattr(again, name), getattr(icrs[0], name), rtol=1e-9)
    assert lines[0] == lines[1] == lines[2]
    assert "rotation" in lines[0]
    with pytest.raises(FrameError, match="between sources is not turned"):
        replace(icrs[0], covariance=np.eye(600)).to_frame("galactic")


def _place(n):
    catalogue = positions(n)
    return catalogue.lon, catalogue.lat


def test_epochs_apart_are_said_first():
    """A rotation of 705 µas with p = 1e-29 was the motion of sixteen years."""
    table = Table(
        {"source_name": ["a", "b", "c"], "ra": [1.0, 99, 200], "dec": [1.0, 40, -50], "ref_epoch": [2016.0] * 3}
    )
    later, earlier = table.copy(), table.copy()
    earlier["ref_epoch"] = 2000.0
    later, earlier = (read_positions(each, sigma=100.0) for each in (later, earlier))
    assert (later.epoch, earlier.epoch) == (2016.0, 2000.0)
    text = "the positions are of 2016 and of 2000, and no motions take them to one epoch"
    assert text in " ".join(map(str, match(later, earlier).notes))
    moving = replace(earlier, motion=np.zeros((2, 3)))
    assert text not in " ".join(map(str, match(later, moving).notes))
    a, b = (replace(positions(), epoch=epoch) for epoch in (2016.0, 2000.0))
    comparison, _ = fit.frames.compare.compare_catalogues(a, moved(b, np.zeros((2, 500))), 1)
    assert "doubt" not in comparison.verdict
    comparison, _ = fit.frames.compare.compare_catalogues(a, replace(moved(b, np.full((2, 500), 1.0)), epoch=2000.0), 1)
    assert comparison.verdict.startswith("doubt the positions are of 2016")
