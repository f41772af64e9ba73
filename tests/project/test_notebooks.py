"""Every public object has a form for notebooks, and gives it."""

import importlib
import inspect
from html.parser import HTMLParser
from pathlib import Path

import pytest
from conftest import ROOT

#: What nobody holds in a notebook: parts of the machinery, panels of pages, axes (matplotlib shows them).
INTERNAL = {
    "Axis", "Prior", "Run", "ParallaxEquations", "ParallaxParts", "ParallaxSums", "Rings", "Passes", "Panel", "ShownPage", "Tree",
    "SkyAxes", "Answer", "TableIO", "SourcesWithErrors", "Frozen",
}  # fmt: skip


def public_classes():
    found = {}
    for package in ("vsh", "sim", "fit", "study"):
        for path in Path(ROOT, package).rglob("__init__.py"):
            face = importlib.import_module(".".join(path.relative_to(ROOT).parts[:-1]))
            for name in getattr(face, "__all__", ()):
                thing = getattr(face, name)
                if inspect.isclass(thing) and not issubclass(thing, (BaseException, tuple)):
                    found[thing] = name
    return [thing for thing, name in found.items() if name not in INTERNAL]


@pytest.mark.parametrize("kind", public_classes(), ids=lambda kind: kind.__name__)
def test_every_public_object_has_a_form_for_notebooks(kind):
    assert callable(getattr(kind, "_repr_html_", None))


class Balanced(HTMLParser):
    """Counts tags that are opened and closed."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("br", "img", "hr", "meta", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.slow
def test_notebook_of_every_object_runs():
    """The page of the gallery that shows them all, executed; each form is whole HTML."""
    source = ROOT / "tests" / "notebook_objects.py"
    space = {"__name__": "notebook"}
    exec(compile(source.read_text(encoding="utf-8"), str(source), "exec"), space)
    shown = {type(each) for each in space["OBJECTS"]}
    for each in space["OBJECTS"]:
        parser = Balanced()
        parser.feed(each._repr_html_())
        assert parser.open == [], type(each)
    # Results of long runs are shown where they are made; these at least are here.
    assert {kind.__name__ for kind in shown} >= {
        "Field",
        "Solution",
        "Vector",
        "Modes",
        "NormalEquations",
        "Population",
        "Signal",
        "Floor",
    }
    assert len(shown) >= 40
