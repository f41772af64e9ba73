"""A directive that runs commands when the pages are built, and shows what the last prints and one of its figures.

```{sample} fit/sky.png
vsh-sim quasars --number 5000 --output quasars.fits
vsh-fit quasars.fits --output fit
```
"""

import hashlib
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
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective

HERE = Path(__file__).parent
KEPT = HERE / "_build" / "samples"


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
        name = f"{Path(self.env.docname).name}.png"
        kept, record = KEPT / name, KEPT / f"{name}.json"
        key = hashlib.sha256("\n".join([_code(), *commands, *self.arguments]).encode()).hexdigest()
        known = json.loads(record.read_text(encoding="utf-8")) if record.exists() else {}
        if known.get("key") != key or (self.arguments and not kept.exists()):
            with tempfile.TemporaryDirectory() as folder:
                if "file" in self.options:
                    shutil.copy(Path(self.get_source_info()[0]).parent / self.options["file"], folder)
                for command in commands:
                    printed = _printed(command, folder)
                KEPT.mkdir(parents=True, exist_ok=True)
                if self.arguments:
                    shutil.copy(Path(folder, self.arguments[0]), kept)
            known = {"key": key, "printed": printed}
            record.write_text(json.dumps(known), encoding="utf-8")
        lines = known["printed"].rstrip().splitlines()
        most = self.options.get("lines", len(lines))
        text = [*lines[:most], *(["…"] if most < len(lines) else [])]
        typed = nodes.literal_block("", "\n".join(f"$ {each}" for each in commands), language="console")
        output = nodes.literal_block("", "\n".join(text), language="text")
        alt = self.options.get("alt", "the figure that is written")
        shown = [nodes.image(uri=f"/_build/samples/{name}", alt=alt)] if self.arguments else []
        return [nodes.container("", typed, output, classes=["sample"]), *shown]


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
    return {"parallel_read_safe": True}
