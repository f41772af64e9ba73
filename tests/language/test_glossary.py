"""The glossary decides: words that it replaces stand nowhere in documentation, help, messages, docstrings and names."""

import ast
import re

from conftest import ROOT, for_each, parsed

FILES = [path for package in ("vsh", "sim", "fit", "study") for path in sorted((ROOT / package).rglob("*.py"))]
GENERATED = {"_build", "gallery", "learn", "_examples", "one"}
PAGES = [path for path in sorted((ROOT / "docs").rglob("*.md")) if not GENERATED & set(path.parts)]
#: Where replaced words are quoted.
QUOTING = {"glossary.md"}


def replaced():
    """The words of the last column, with the term that replaces them."""
    rows = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    for row in rows[rows.index("|---|---|---|---|---|") + 1 :]:
        term, *_, words = (cell.strip() for cell in re.split(r"(?<!\\)\|", row.strip().strip("|")))
        for each in filter(None, (word.strip() for word in words.split(";"))):
            yield each, term


WORDS = dict(replaced())
PATTERN = re.compile("|".join(rf"(?<!\w){re.escape(word)}(?!\w)" for word in sorted(WORDS, key=len, reverse=True)))


def faults(text):
    """The replaced words of a text, each with the term to use."""
    flat = re.sub(r"\s+", " ", text)
    return [f"{word!r} is {WORDS[word]!r} in the glossary" for word in PATTERN.findall(flat)]


def test_replaced_words_are_found():
    assert len(WORDS) > 15
    assert faults("with what sources\n    share, 95 % hold") == [
        "'what sources share' is 'systematic errors' in the glossary",
        "'% hold' is 'coverage' in the glossary",
    ]
    assert not faults("systematic errors; nominal coverage; a file holds rows")


@for_each([*PAGES, ROOT / "README.md"], lambda path: path.relative_to(ROOT).as_posix())
def test_pages_use_the_terms(path):
    assert path.name in QUOTING or faults(path.read_text(encoding="utf-8")) == []


@for_each(FILES, lambda path: path.relative_to(ROOT).as_posix())
def test_code_uses_the_terms(path):
    texts = [
        node.value for node in ast.walk(parsed(path)) if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    assert faults("\n".join(texts)) == []
