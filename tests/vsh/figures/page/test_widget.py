"""The sky in a notebook: a frame with the page, and a widget where ipywidgets is there."""

import sys
from html import unescape
from types import SimpleNamespace

import pytest
from conftest import random_field

import fit


@pytest.fixture
def solved():
    field = random_field(300, seed=1)
    return fit.fit_field(field, 2), field


def test_page_in_a_frame(solved, monkeypatch):
    monkeypatch.setattr("vsh.figures.page._page.find_spec", lambda name: None)
    solution, field = solved
    html = solution.widget(field, height=500)._repr_html_()
    assert html.startswith('<iframe srcdoc="')
    assert "height: 500px" in html
    inner = unescape(html.split('srcdoc="')[1].split('" style')[0])
    assert 'id="sky-data"' in inner
    assert "http://" not in inner.replace("http://www.w3.org", "")


def test_widget_where_there_are_some(solved, monkeypatch):
    monkeypatch.setattr("vsh.figures.page._page.find_spec", lambda name: object())
    monkeypatch.setitem(sys.modules, "ipywidgets", SimpleNamespace(HTML=lambda html: ("widget", html)))
    kind, html = solved[0].widget(solved[1])
    assert kind == "widget"
    assert "<iframe" in html
