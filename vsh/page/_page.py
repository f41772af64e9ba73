"""A page: its panels in order, with the styles and scripts they need and leave to run nothing else."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterable
from functools import lru_cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from vsh.checks.types import PathName
from vsh.page._panels import Panel
from vsh.system.files import atomic_write

_SEAL = re.compile(r"<!-- sha256 of the rest: ([0-9a-f]{64}) -->\n")
#: What is said of a sky where there is no `bundle`.
STATIC = "cannot be turned: this package was built without the script (make page, with npm)"
_PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src $style_hash; script-src $script_hashes">
<meta name="generator" content="vsh-astrometry">
<title>$title</title>
<link rel="icon" href="data:,">
<style>$style</style>
</head>
<body>
<main>
<h1>$title</h1>
$lead
$body
</main>
$scripts
</body>
</html>
""")


def page(title: str, panels: Iterable[Panel], *, lead: str = "") -> str:
    """One HTML file of panels, which asks for nothing from any network.

    Parameters
    ----------
    title : str
        Of the page.
    panels : iterable of Panel
        In order; empty ones are left out.
    lead : str
        Under the title.

    Returns
    -------
    str
        A Content-Security-Policy in it allows its own style and scripts, by their hashes, and pictures within it.
    """
    kept = [panel for panel in panels if panel.html]
    needed = list(dict.fromkeys(script for panel in kept for script in panel.scripts))
    texts = [bundle() if name == "d3" else _asset(f"{name}.js") for name in needed]
    style = _asset("page.css")
    return _PAGE.substitute(
        title=escape(title), lead=f'<p class="lead">{escape(lead)}</p>' if lead else "", style=style, style_hash=_hash(style),
        body="\n".join(panel.html for panel in kept), scripts="\n".join(f"<script>{text}</script>" for text in texts),
        script_hashes=" ".join(map(_hash, texts)) or "'none'",
    )  # fmt: skip


@lru_cache
def bundle() -> str:
    """The script that projects the sky, d3 with its licences; empty where the package was built without it."""
    try:
        licences, script = _asset("d3.LICENSES.txt"), _asset("d3.min.js")
    except OSError:
        return ""
    return f"/*\n{licences.replace('*/', '')}*/\n{script}"


def write_page(path: PathName, text: str) -> None:
    """Write a page with a hash of the rest of it, by which a later run sees that nobody changed it.

    Parameters
    ----------
    path : str or Path
        The file.
    text : str
        Of `page`.
    """
    seal = f"<!-- sha256 of the rest: {hashlib.sha256(text.encode()).hexdigest()} -->\n"
    head, end = text.rsplit("</html>", 1)
    with atomic_write(path) as new:
        new.write_text(f"{head}{seal}</html>{end}", encoding="utf-8")


def is_page(path: PathName) -> bool:
    """Whether a file is a page that `write_page` wrote, and as it was written."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    seals = list(_SEAL.finditer(text))
    if not seals:
        return False
    rest = text[: seals[-1].start()] + text[seals[-1].end() :]
    return seals[-1].group(1) == hashlib.sha256(rest.encode()).hexdigest()


def _hash(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _asset(name):
    return files("vsh.page").joinpath(name).read_text(encoding="utf-8")
