import re
from html.parser import HTMLParser

import pytest
from astropy.table import Table
from conftest import ROOT, random_field

import fit
from fit.commands.fit import main


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("html") / "report.html"
    assert main([str(ROOT / "fit" / "demo.fits"), "--lmax", "2", "--html", str(path)]) == 0
    return path.read_text(encoding="utf-8")


class Reader(HTMLParser):
    """Tags that are opened and closed in order, and all that the page asks for."""

    void = {"meta", "link", "img", "br", "input"}  # noqa: RUF012

    def __init__(self):
        super().__init__()
        self.open, self.wanted, self.tags = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.wanted += [value for name, value in attrs if name in ("src", "href")]
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_whole_and_asks_for_nothing(page):
    reader = Reader()
    reader.feed(page)
    assert not reader.open
    assert all(wanted.startswith(("data:", "#")) for wanted in reader.wanted)
    assert reader.tags.count("img") == 4  # of the sky where no script runs, and three figures
    code = re.sub(r"/\*.*?\*/", "", page, flags=re.DOTALL)  # licences may name addresses
    assert not re.search(r"https?://|url\(|@import|fetch\(|XMLHttpRequest", code)


def test_page_agrees_with_the_report(page):
    for words in ("acceleration", "truth", "Power by degree", "agrees to", "sha256", "vsh-fit", "--lmax 2",
                  "prefers-color-scheme: dark", "width=device-width"):  # fmt: skip
        assert words in page
    assert page.count('class="sortable"') == 3


def test_page_escapes_what_a_table_contains(tmp_path, capsys):
    table = Table.read(ROOT / "fit" / "demo.fits")[:300]
    path = tmp_path / "<b>&.fits"
    table.write(path)
    assert main([str(path), "--lmax", "1", "--html", str(tmp_path / "report.html")]) == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<b>&.fits" not in page
    assert "&lt;b&gt;&amp;.fits" in page
    assert main([str(path), "--html", str(tmp_path / "none" / "report.html")]) == 1
    assert "there is no folder" in capsys.readouterr().err


def test_page_of_a_recommended_fit_is_that_of_its_solution(tmp_path):
    field = random_field(300, 1)
    best = fit.recommended(field)
    truth = {"spin": best.spin}
    for name, result in (("result", best), ("solution", best.solution)):
        fit.output.write_html(result, field, tmp_path / f"{name}.html", truth=truth)
    one, two = ((tmp_path / f"{name}.html").read_text(encoding="utf-8") for name in ("result", "solution"))
    assert len(one) == len(two)
    assert best.report(truth=truth) == best.solution.report(truth=truth)
