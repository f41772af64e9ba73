"""Two directives: commands that run when the pages are built, and a sheet of all figures of the documentation.

```{sample} fit/sky.png
vsh-sim quasars --number 5000 --output quasars.fits
vsh-fit quasars.fits --output fit
```

shows what the last of them prints and one of the figures. `{sheet}` shows every figure that a sample, an example or a
tutorial has drawn, each linked to the page that draws it.
"""

import hashlib
import html
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from PIL import Image
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

HERE = Path(__file__).parent
KEPT = HERE / "_build" / "samples"
#: What stands in the page of figures until they are drawn.
SHEET = "<!-- all figures -->"


class Sample(SphinxDirective):
    """Its argument is the figure; `lines` how much is shown of what is printed, `alt` what is seen, `file` what is read."""

    has_content = True
    optional_arguments = 1
    option_spec: ClassVar = {
        "lines": directives.positive_int,
        "alt": directives.unchanged,
        "file": directives.unchanged,
    }

    def run(self):
        commands = [line for line in self.content if line.strip()]
        name = Path(self.env.docname).name
        kept, record = KEPT / name, KEPT / f"{name}.json"
        key = hashlib.sha256("\n".join([_code(), *commands, *self.arguments]).encode()).hexdigest()
        known = json.loads(record.read_text(encoding="utf-8")) if record.exists() else {}
        if known.get("key") != key or not kept.exists():
            with tempfile.TemporaryDirectory() as folder:
                if "file" in self.options:
                    shutil.copy(Path(self.get_source_info()[0]).parent / self.options["file"], folder)
                for command in commands:
                    printed = _printed(command, folder)
                shutil.rmtree(kept, ignore_errors=True)
                kept.mkdir(parents=True)
                for figure in Path(folder).rglob("*.png"):
                    shutil.copy(figure, kept / _flat_name(figure.relative_to(folder)))
            known = {"key": key, "printed": printed}
            record.write_text(json.dumps(known), encoding="utf-8")
        lines = known["printed"].rstrip().splitlines()
        most = self.options.get("lines", len(lines))
        text = [*lines[:most], *(["…"] if most < len(lines) else [])]
        typed = nodes.literal_block("", "\n".join(f"$ {each}" for each in commands), language="console")
        output = nodes.literal_block("", "\n".join(text), language="text")
        alt = self.options.get("alt", "the figure that is written")
        shown = [nodes.image(uri=f"/_build/samples/{name}/{_flat_name(figure)}", alt=alt) for figure in self.arguments]
        return [nodes.container("", typed, output, classes=["sample"]), *shown]


class Sheet(SphinxDirective):
    """The place of the thumbnails of all figures."""

    def run(self):
        return [nodes.raw("", f'<div class="sheet">{SHEET}</div>', format="html")]


def _fill_sheet(app, error):
    """Put thumbnails where the sheet is, when all pages have drawn their figures."""
    page = Path(app.outdir, "figures.html")
    if error is not None or app.builder.name != "html" or not page.exists():
        return
    drawn = [(path, f"commands/{path.parent.name}") for path in sorted(KEPT.glob("vsh-*/*.png"))]
    drawn += [(path, "figures") for path in sorted(KEPT.glob("figures/*.png"))]
    for path in sorted(
        path for folder in ("gallery", "learn") for path in HERE.glob(f"{folder}/**/images/sphx_glr_*.png")
    ):
        script = path.name.removeprefix("sphx_glr_").rsplit("_", 1)[0]
        drawn.append((path, (path.parents[1].relative_to(HERE) / script).as_posix()))
    folder, cells = Path(app.outdir, "_images", "sheet"), []
    folder.mkdir(parents=True, exist_ok=True)
    for number, (path, source) in enumerate(drawn):
        with Image.open(path) as picture:
            picture.thumbnail((440, 440))
            picture.save(folder / f"{number}.png")
        name = source.rsplit("/", 1)[-1]
        alt = html.escape(f"{name}: {path.stem.removeprefix('sphx_glr_').replace('_', ' ')}")
        cells.append(
            f'<a href="{source}.html"><img src="_images/sheet/{number}.png" alt="{alt}" loading="lazy">{name}</a>'
        )
    page.write_text(page.read_text(encoding="utf-8").replace(SHEET, "\n".join(cells)), encoding="utf-8")


def _flat_name(figure):
    return "_".join(Path(figure).parts)


@cache
def _code():
    """What the commands are made of: a sample is run again when any of it has changed."""
    digest = hashlib.sha256()
    for package in ("vsh", "fit", "sim", "study"):
        for path in sorted((HERE.parent / package).rglob("*")):
            if path.suffix in (".py", ".toml", ".txt", ".css", ".js", ".fits"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _printed(command, folder):
    """What a command prints, run in a folder."""
    program, *rest = shlex.split(command)
    words = [sys.executable, "-m", "vsh", program.removeprefix("vsh-"), *rest]
    there = os.environ | {"PYTHONPATH": str(HERE.parent), "COLUMNS": "100"}
    done = subprocess.run(words, cwd=folder, env=there, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ExtensionError(f"{command}: {done.stderr}")
    return done.stdout


def setup(app):
    """As Sphinx wants it."""
    app.add_directive("sample", Sample)
    app.add_directive("sheet", Sheet)
    app.connect("build-finished", _fill_sheet)
    return {"parallel_read_safe": True}
