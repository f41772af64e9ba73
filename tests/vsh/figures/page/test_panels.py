"""What a page is made of, and that nothing in it can break it."""

import base64
import hashlib
import re
from html.parser import HTMLParser

import numpy as np
from astropy.table import Table

from vsh.figures import page
from vsh.figures.page import Panel
from vsh.io.sections import Section


class Reader(HTMLParser):
    """Tags in order, each closed, and what is in scripts and styles."""

    void = {"meta", "link", "img", "br", "input"}  # noqa: RUF012

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.words, self.code = [], [], [], {"script": [], "style": []}

    def handle_starttag(self, tag, attrs):
        assert not any(name.startswith("on") or name == "style" for name, _ in attrs), attrs  # the policy forbids them
        self.tags.append(tag)
        if tag not in self.void:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        kind = self.open[-1] if self.open else ""
        self.code.get(kind, self.words).append(data)


def read(html):
    reader = Reader()
    reader.feed(html)
    assert not reader.open
    return reader


NASTY = "<b>&\"'</script>"


def test_page_of_everything_is_whole():
    columns = Table({"a_b": [1.0, np.nan], NASTY: [NASTY, "x"]})
    panels = [
        page.facts_panel([("spin", NASTY)], "answer"), page.paragraph(NASTY, "warning"), page.paragraph(""), page.section_panel(Section(NASTY, (), columns)),
        page.table(["x", ""], [[NASTY, "1"]], sortable=True, summary=NASTY), page.figure_panel(b"png", NASTY), page.notes_panel([NASTY, 3]),
        page.panel_row([page.figure_panel(b"png", "one"), page.figure_panel(b"png", "two")]), page.preformatted_panel(NASTY),
        page.provenance_panel({"file": NASTY, "versions": {"numpy": "2"}}, ["vsh-fit", NASTY]), page.join_panels("empty", Panel("")),
    ]  # fmt: skip
    html = page.page(NASTY, panels, lead=NASTY)
    reader = read(html)
    assert reader.tags.count("img") == 3
    assert sum(NASTY in word for word in reader.words) >= 10
    assert "empty" not in html
    assert "a b" in html
    assert html.count("<script>") == 1  # of the tables


def test_policy_allows_what_is_there_and_nothing_else():
    html = page.page("t", [page.table(["x"], [["1"]], sortable=True)])
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html).group(1)
    assert policy.startswith("default-src 'none'; img-src data:;")
    assert "unsafe" not in policy
    reader = read(html)
    for text in ("".join(reader.code["style"]), "".join(reader.code["script"])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert "script-src 'none'" in page.page("t", [page.paragraph("x")])


def test_long_tables_say_what_is_left_out():
    html = page.section_panel(Section("Rows", (), Table({"x": np.arange(500)}))).html
    assert html.count("<tr>") == 201
    assert "The first 200 of 500 rows" in html


def test_headings_with_the_same_words_have_anchors_of_their_own():
    html = page.page("x", [page.join_panels("Sources & more", page.paragraph(str(k))) for k in range(4)])
    anchors = re.findall('<h2 id="([^"]+)">', html)
    assert len(set(anchors)) == 4
    assert anchors[0] == "sources-more"
    assert re.findall('<a href="#([^"]+)">', html) == anchors
