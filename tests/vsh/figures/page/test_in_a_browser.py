"""Pages in headless Chromium: what they do, ask for, weigh and how soon; skipped where there is no browser."""

import contextlib
import functools
import json
import os
import re
import shutil
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import DATA, ROOT, random_field

import fit
import sim
from fit.commands.fit import main
from vsh import Field
from vsh.commands import COMMANDS as LISTED
from vsh.figures.plot import even_grid, sky_axes
from vsh.figures.plot._field import make_arrow_lines
from vsh.io import catalogue
from vsh.io.astrometry import write_astrometry

playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install -e '.[browser]'")
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe: pip install -e '.[browser]'")
CHROMIUM = os.environ.get("CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="no Chromium on this machine (CHROMIUM=/path/to/it)")
TD = DATA / "td2017_vlba_proper_motions.ecsv"
QUIET = ("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
         "--disable-component-update", "--disable-sync")  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        found = started.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        yield found
        found.close()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Of the demo, the VLBA table, two fits side by side, and 20 000 sources at degree 10."""
    folder = tmp_path_factory.mktemp("pages")
    made = {"demo": ["--demo", "--lmax", "3"]}
    if TD.exists():
        made["vlba"] = [str(TD), "--lmax", "3", "--method", "clip=3"]
    many = random_field(20_000, seed=1)
    many.write(folder / "many.fits")
    made["many"] = [str(folder / "many.fits"), "--lmax", "10"]
    for name, words in made.items():
        assert main([*words, "--html", str(folder / f"{name}.html")]) == 0
    field = catalogue.read_field(ROOT / "fit" / "demo.fits")
    plain, clipped = fit.fit_field(field, 2), fit.clip(field, 2).solution
    fit.output.write_html(clipped, field, folder / "beside.html", beside={"plain": (plain, field)})
    return {name: folder / f"{name}.html" for name in (*made, "beside")}


NAMES = ["demo", "vlba", "beside", "many"]
#: A small job of each command that writes a page.
COMMANDS = {
    "correlate": "correlate q.fits --leakage 2",
    "compare": "compare icrf_a.csv icrf_b.csv",
    "redshift": "redshift g.fits --h0 70 --redshift-frame true --bins 2",
    "link": "link gaia.csv vlbi.csv --steps 13",
    "pairs": "pairs q.fits",
    "waves": "waves epochs.fits --frequencies 0.5:1:2",
    "referee": "referee crf3.fits --on-bad drop",
    "forecast": "forecast",
    "fit": "fit q.fits --lmax 3 --waves",
}


@pytest.fixture(scope="module")
def command_pages(tmp_path_factory):
    """A page of each command, made when it is first asked for."""
    folder = tmp_path_factory.mktemp("commands")
    with contextlib.chdir(folder):
        quasars = sim.quasars(600, 1)
        sim.observe(quasars, sim.spin((10.0, 0, 0)), 2, sigma=30.0).write("q.fits")
        galaxies = sim.observe(sim.galaxies(800, 1), sim.secular_parallax((300.0, 0, 0)), 2, sigma=20.0)
        galaxies.write("g.fits")
        sim.crf3(1, n_five=3000, n_six=100).write("crf3.fits")
        sim.epochs(sim.quasars(20, 1), sim.spin((0, 0, 0)), 2).write("epochs.fits")
        stars = sim.link(1, 20)
        for name in ("gaia", "vlbi"):
            write_astrometry(stars[stars.catalogue == name], f"{name}.csv")
        rng = np.random.default_rng(1)
        for name in "ab":
            places = np.degrees([quasars.lon, quasars.lat]) + rng.normal(0, 3e-8, (2, len(quasars)))
            rows = [f"S{i},{a:.12f},{d:.12f},0.1,0.1" for i, (a, d) in enumerate(places.T)]
            Path(f"icrf_{name}.csv").write_text("\n".join(["name,ra,dec,ra_error,dec_error", *rows]) + "\n")

    @functools.cache
    def make(name):
        command, *words = COMMANDS[name].split()
        with contextlib.chdir(folder):
            assert import_module(LISTED[command].module).main([*words, "--html", f"{name}.html"]) == 0
        return folder / f"{name}.html"

    return make


def opened(browser, path, width=1280, scheme="light"):
    """The page, and all that it said and asked for."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    tab, said = context.new_page(), []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on(
        "request", lambda request: said.append(request.url) if not request.url.startswith(("data:", "file:")) else None
    )
    tab.goto(path.as_uri())
    tab.wait_for_selector("body[data-ready]" if tab.locator("canvas").count() else "h1", timeout=20_000)
    return tab, said


def page_of(pages, name):
    if name not in pages:
        pytest.skip(f"{TD.name} is not here")
    return pages[name]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("name", NAMES)
def test_page_works_offline_and_is_accessible(browser, pages, name, width, scheme):
    path = page_of(pages, name)
    assert path.stat().st_size < 2.2e6  # 20 000 sources are 1.9 MB, and the picture without a script a tenth of one
    tab, said = opened(browser, path, width, scheme)
    text = lambda: tab.inner_text("#said-0")  # noqa: E731
    first = text()
    assert "expected by chance" in first or "not detected" in first
    tab.focus("#degree")
    tab.keyboard.press("Home")
    assert "degree 1, T and S" in text()
    tab.select_option("#kinds", "S")
    assert "degree 1, S: rms" in text()
    tab.keyboard.press("Home")
    tab.focus("#degree")
    tab.keyboard.press("ArrowRight")
    tab.check("#only")
    assert "degree 2 alone, S" in text()
    assert tab.inner_text("#degree-text") == "2"
    # Turned, zoomed and read by keys alone.
    tab.focus("canvas")
    for key in ("ArrowLeft", "ArrowUp", "+", "n"):
        tab.keyboard.press(key)
    assert "residual (" in text()
    assert " σ." in text()
    tab.keyboard.press("Escape")
    assert "rms" in text()
    for kind in ("mollweide", "globe", "polar"):
        tab.select_option("#projection", kind)
        tab.wait_for_function("document.querySelector('canvas').sky.lines.length > 20")
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    # The lines to quote, and all that is words, stand there whole; tables of numbers alone may be scrolled.
    cut = """Array.from(document.querySelectorAll('td.broken')).filter(cell =>
        cell.getBoundingClientRect().right > cell.closest('.wide').getBoundingClientRect().right + 1).length"""
    assert tab.evaluate(cut) == 0
    assert tab.evaluate("document.querySelectorAll('td.broken').length") > 4
    assert said == []
    found = axe.Axe().run(tab)
    assert found.violations_count == 0, found.generate_report()
    tab.context.close()


@pytest.mark.parametrize("name", COMMANDS)
def test_page_of_every_command(browser, command_pages, name):
    """On a phone, a tablet and a screen, light and dark, on paper and without a script: nothing asked, said or cut."""
    path = command_pages(name)
    for width, scheme in ((390, "light"), (390, "dark"), (768, "light"), (1440, "dark"), (1440, "light")):
        tab, said = opened(browser, path, width, scheme)
        assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), width
        assert said == []
        found = axe.Axe().run(tab)
        assert found.violations_count == 0, found.generate_report()
        if width == 1440 and scheme == "dark":
            tab.emulate_media(media="print", color_scheme="dark")
            light = tab.evaluate("getComputedStyle(document.body).backgroundColor")
            assert light in ("rgb(255, 255, 255)", "rgba(0, 0, 0, 0)")
        tab.context.close()
    bare = browser.new_context(java_script_enabled=False)
    tab = bare.new_page()
    tab.goto(path.as_uri())
    with_script = path.read_text(encoding="utf-8")
    assert tab.locator("h1").count() == 1
    assert tab.locator("table").count() == len(
        re.findall("<table", re.sub("<script.*?</script>", "", with_script, flags=re.DOTALL))
    )
    bare.close()


@pytest.mark.parametrize("projection", ["hammer", "mollweide", "globe", "polar"])
@pytest.mark.parametrize("centre", [(0, 0), (257, -12), (40, 60)])
def test_its_arrows_are_those_of_the_figure(browser, pages, projection, centre):
    """Two codes, d3 and WCSAxes, draw the same fit: tails, tips and directions on the map."""
    field = catalogue.read_field(ROOT / "fit" / "demo.fits")
    solution = fit.recommended(field, 3).solution
    tab, _ = opened(browser, pages["demo"])
    lines = json.loads(
        tab.evaluate(
            """([kind, lon, lat]) => {
        const choose = document.getElementById("projection"), sky = document.querySelector("canvas").sky;
        choose.value = kind;
        choose.dispatchEvent(new Event("input"));
        sky.projection.rotate([-lon, -lat]);
        sky.turned = () => [-lon, -lat];
        sky.paint();
        return JSON.stringify({lines: sky.lines, middle: sky.projection([lon, lat]), radius: sky.projection.scale()});
    }""",
            [projection, *centre],
        )
    )
    tab.context.close()
    axes = sky_axes(projection=projection, centre=centre)
    grid = even_grid(9.2)
    motion = solution.coefficients.at(*grid)
    length = np.radians(11.0 * 9.2 / 12) * np.hypot(*motion) / np.hypot(*motion).max()
    drawn, fits = make_arrow_lines(axes, *grid, motion, length)
    plt.close(axes.figure)
    high, wide = axes.wcs.array_shape
    # Both in units of the radius of the sphere, from the middle, upwards.
    scale = (
        wide
        / 2
        / {"hammer": 2 * np.sqrt(2), "mollweide": 2 * np.sqrt(2), "globe": 1.0, "polar": np.sqrt(2)}[projection]
    )
    own = {
        i: (line - [wide / 2 - 0.5, high / 2 - 0.5]) / scale
        for i, line in zip(np.flatnonzero(fits), drawn, strict=True)
    }
    theirs = {
        each["i"]: (np.array(each["points"]) - lines["middle"]) / lines["radius"] * [1, -1] for each in lines["lines"]
    }
    both = sorted(set(own) & set(theirs))
    assert len(both) >= (480 if axes.is_whole else 200)
    assert len(set(own) ^ set(theirs)) <= 0.05 * len(both)  # at the very rim one of them may move an arrow out of sight
    ends = np.array([[own[i][[0, -1]], theirs[i][[0, -1]]] for i in both])
    apart = np.abs(ends[:, 0] - ends[:, 1]).max((1, 2))
    same = apart < 0.004
    assert same.mean() > 0.97  # those at the seam may lie before their place in one and behind it in the other
    turn = [np.angle(np.exp(1j * (np.subtract(*_angles(end)))), deg=True) for end in ends[same]]
    assert np.abs(turn).max() < 1.5
    # And both are the motions: the sure ones are those of the page's colours.
    error = np.sqrt(np.einsum("pn,pq,qn->n", along := _along(solution, grid, motion), solution.covariance, along))
    sure = {i for i in range(len(error)) if np.hypot(*motion[:, i]) > 2 * error[i]}
    assert {each["i"] for each in lines["lines"] if each["sure"]} <= sure


def _angles(ends):
    return [np.arctan2(*(each[1] - each[0])[::-1]) for each in ends]


def _along(solution, grid, motion):
    from vsh.basis import harmonics

    return np.einsum("pin,in->pn", harmonics(*grid, solution.modes), motion / np.hypot(*motion))


def test_tables_sort(browser, pages):
    tab, _ = opened(browser, pages["demo"])
    powers = tab.locator("table.sortable").filter(has_text="debiased").first

    def column():
        return [float(x) for x in powers.locator("tbody tr td:nth-child(2)").all_inner_texts()]

    button = powers.locator("th button").nth(1)
    button.focus()
    tab.keyboard.press("Enter")
    assert column() == sorted(column())
    tab.keyboard.press("Enter")
    assert column() == sorted(column(), reverse=True)
    assert powers.locator("th").nth(1).get_attribute("aria-sort") == "descending"
    tab.context.close()


def test_sources_are_read_under_the_pointer(browser, pages):
    tab, _ = opened(browser, pages["demo"])
    tab.locator("canvas").scroll_into_view_if_needed()
    at = tab.evaluate("""() => { const sky = document.querySelector("canvas").sky, box = sky.canvas.getBoundingClientRect();
        return [box.left + sky.x[5], box.top + sky.y[5]]; }""")
    tab.mouse.move(*at)
    for _ in range(100):  # to wait for a function would be to evaluate text, which the page forbids
        if "residual" in tab.inner_text("#said-0"):
            break
        tab.wait_for_timeout(50)
    assert "residual" in tab.inner_text("#said-0")
    tab.mouse.down()
    tab.mouse.move(at[0] + 100, at[1])
    tab.mouse.up()
    middle = tab.evaluate("document.querySelector('canvas').sky.projection.rotate()")
    assert abs(middle[0]) > 5  # it followed
    tab.context.close()


def test_every_dot_has_its_own_name(browser, pages):
    """A thousand of 20 000: name and place are those of one row of the catalogue."""
    field = Field.read(pages["many"].with_suffix(".fits"))
    tab, _ = opened(browser, pages["many"])
    sent = json.loads(
        tab.evaluate("""() => { const { given, sources, n } = document.querySelector("canvas").sky;
            return JSON.stringify(Array.from({ length: n }, (_, i) => [given.names[i], sources.lon[i], sources.lat[i]])); }""")
    )
    tab.context.close()
    row_of = {str(name): row for row, name in enumerate(field.name)} if field.name is not None else {}
    rng = np.random.default_rng(1)
    for name, lon, lat in (sent[i] for i in rng.choice(len(sent), 1000, replace=False)):
        row = row_of[name]
        assert np.degrees([field.lon[row], field.lat[row]]) == pytest.approx([lon, lat], abs=1e-4)


def test_a_tap_a_name_and_a_row_show_a_source(browser, pages):
    context = browser.new_context(viewport={"width": 390, "height": 800}, has_touch=True, is_mobile=True)
    tab = context.new_page()
    tab.goto(pages["demo"].as_uri())
    tab.wait_for_selector("body[data-ready]")
    tab.locator("canvas").scroll_into_view_if_needed()
    box = tab.locator("canvas").bounding_box()
    x, y, name = tab.evaluate(
        "(() => { const s = document.querySelector('canvas').sky; return [s.x[5], s.y[5], s.given.names[5]]; })()"
    )
    tab.touchscreen.tap(box["x"] + x, box["y"] + y)
    assert tab.inner_text("#said-0").startswith(f"{name}: ")
    tab.fill("#go", "no such source")
    tab.press("#go", "Enter")
    assert "no source" in tab.inner_text("#went")
    other = tab.evaluate("document.querySelector('canvas').sky.given.names[9]")
    tab.fill("#go", other)
    tab.press("#go", "Enter")
    assert tab.inner_text("#went") == ""
    assert tab.inner_text("#said-0").startswith(f"{other}: ")
    tab.fill("#go", "83.63 -22.01")
    tab.press("#go", "Enter")
    assert tab.evaluate("document.querySelector('canvas').sky.projection.rotate()")[:2] == pytest.approx(
        [-83.63, 22.01]
    )
    context.close()


def test_two_skies_have_one_scale(browser, pages):
    """The same place in both: pixels of its arrow over its motion."""
    tab, _ = opened(browser, pages["beside"])
    largest, *scales = tab.evaluate("""() => {
        const skies = Array.from(document.querySelectorAll("canvas"), (canvas) => canvas.sky);
        const scale = (sky) => Object.fromEntries(sky.lines.map(({ i, points }) => {
            let length = 0;
            for (let k = 1; k < 7; k++) length += Math.hypot(points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]);
            return [i, length / Math.hypot(sky.motion[i], sky.motion[sky.motion.length / 2 + i])];
        }));
        return [skies.map((sky) => sky.largest), ...skies.map(scale)];
    }""")
    tab.context.close()
    assert largest[0] != largest[1]
    ratios = [scales[0][i] / scales[1][i] for i in set(scales[0]) & set(scales[1])]
    assert len(ratios) > 200
    assert np.median(ratios) == pytest.approx(1, abs=0.01)


def test_it_is_light_on_paper_and_a_picture_without_a_script(browser, pages):
    tab, _ = opened(browser, pages["demo"], scheme="dark")
    ground = "getComputedStyle(document.documentElement).getPropertyValue('--back')"
    assert tab.evaluate(ground) == "#0d1117"
    tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert tab.evaluate(ground) == "#ffffff"
    tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert tab.evaluate(ground) == "#0d1117"
    assert not tab.locator("img.still").is_visible()
    tab.context.close()
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto(pages["demo"].as_uri())
    assert tab.locator("img.still").is_visible()
    assert not tab.locator("canvas").is_visible()
    assert not tab.locator(".controls").is_visible()
    context.close()


def test_contents_lead_to_what_they_name(browser, pages):
    tab, _ = opened(browser, pages["demo"])
    links = tab.locator("nav.contents a")
    assert links.count() >= 6
    for i in range(links.count()):
        assert tab.locator(links.nth(i).get_attribute("href")).inner_text() == links.nth(i).inner_text()
    assert tab.title().startswith("the simulated catalogue of the demo: ")
    with tab.expect_download() as saved:
        tab.locator("a.save").first.click()
    assert saved.value.suggested_filename.endswith(".csv")
    tab.context.close()
