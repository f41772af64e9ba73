"""Every figure can be drawn on axes that are given, and gives back those it is on."""

import ast

import pytest
from conftest import ROOT

DRAWING = [
    (path.relative_to(ROOT).as_posix(), node.name, node)
    for package in ("vsh", "sim", "fit", "study")
    for path in sorted((ROOT / package).rglob("*.py"))
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.FunctionDef) and (node.name.startswith("plot_") or node.name in ("plot", "corner", "trace"))
]


def test_there_are_figures():
    assert len(DRAWING) > 60


@pytest.mark.parametrize(("path", "name", "node"), DRAWING, ids=lambda each: each if isinstance(each, str) else "")
def test_figures_take_and_return_axes(path, name, node):
    assert "ax" in [each.arg for each in node.args.kwonlyargs]
    assert ast.unparse(node.returns) in ("Axes", "AxesArray", "SkyAxes", "Any")
    assert ast.get_docstring(node)
