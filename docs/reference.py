"""The reference: pages of `api/` list the names of a module in tables, and each name has a page of its own.

A block `.. automodule:: M` with `:members:` becomes a table of these names, each with the first line of its docstring and
a link to `api/one/M.name`, which has the whole docstring and, below it, the names that stand beside it in the table.
"""

import importlib
import inspect
import re
import shutil
from pathlib import Path

_BLOCK = re.compile(r"\.\. automodule:: ([\w.]+)\n((?:   :[^\n]*\n)*)")
#: So many neighbours are named below a docstring.
_BESIDE = 8


def escape(lines):
    """Docstrings are written to be read as they are, in place: µ_α*, |v| and ω_ are no markup."""
    for i, line in enumerate(lines):
        if line.lstrip().startswith((">>>", "...")) or "``" in line:
            continue
        parts = line.split("`")
        for k in range(0, len(parts), 2):
            parts[k] = re.sub(r"(?<!\\)[*|]", r"\\\g<0>", parts[k])
            parts[k] = re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", parts[k])
        lines[i] = "`".join(parts)


def names_of(module, options):
    """The names that a block shows, in its order."""
    listed = re.search(r":members:[ ]*(.*)", options)
    if listed is None:
        return []
    own = importlib.import_module(module)
    if listed[1]:
        return listed[1].split(", ")
    apart = re.search(r":exclude-members: (.+)", options)
    left_out = apart[1].split(", ") if apart else []
    public = getattr(own, "__all__", None)
    if public is not None:
        return [name for name in public if name not in left_out]
    return [name for name, each in vars(own).items() if name[0] != "_" and getattr(each, "__module__", "") == module]


def directive_of(thing):
    """The directive that documents it, with options."""
    if inspect.isclass(thing):
        if issubclass(thing, BaseException):
            return "autoexception", ["show-inheritance:"]
        return "autoclass", ["members:"]
    return ("autofunction", []) if callable(thing) else ("autodata", ["no-value:"])


def write_pages(app):
    """A page for every name, anew each time."""
    api = Path(app.srcdir) / "api"
    one = api / "one"
    shutil.rmtree(one, ignore_errors=True)
    one.mkdir()
    for page in sorted(api.glob("*.md")):
        for module, options in _BLOCK.findall(page.read_text(encoding="utf-8")):
            names = names_of(module, options)
            for name in names:
                full = f"{module}.{name}"
                directive, more = directive_of(getattr(importlib.import_module(module), name))
                if ":no-inherited-members:" in options and directive == "autoclass":
                    more = [*more, "no-inherited-members:"]
                place = names.index(name)
                beside = [each for each in [*names[place + 1 :], *names[:place]] if each != name][:_BESIDE]
                also = ", ".join(f":py:obj:`{each} <{module}.{each}>`" for each in beside)
                lines = [
                    ":orphan:", "", name, "=" * len(name), "", f"In :doc:`{module} </api/{page.stem}>`.", "",
                    f".. {directive}:: {full}", *(f"   :{option}" for option in more), "",
                    *([".. seealso::", "", f"   {also}", ""] if also else []),
                ]  # fmt: skip
                (one / f"{full}.rst").write_text("\n".join(lines), encoding="utf-8")


def as_tables(app, docname, source):
    """Blocks of a page as tables of what is on pages of their own."""
    if not docname.startswith("api/") or docname.startswith("api/one/"):
        return

    seen = set()

    def table(block):
        module, options = block.groups()
        names = names_of(module, options)
        if not names:
            return block[0]
        head = f".. py:module:: {module}\n\n" if module not in seen else ""
        if not seen.add(module) and ":no-index:" not in options:
            lines = inspect.getdoc(importlib.import_module(module)).splitlines()
            escape(lines)
            head += "\n".join(lines) + "\n\n"
        rows = "".join(f"   {name}\n" for name in names)
        return f"{head}.. py:currentmodule:: {module}\n\n.. autosummary::\n   :nosignatures:\n\n{rows}"

    source[0] = _BLOCK.sub(table, source[0])


def setup(app):
    """Tables in place of members, and a page for each."""
    app.setup_extension("sphinx.ext.autosummary")
    app.connect("builder-inited", write_pages)
    app.connect("source-read", as_tables)
    return {"parallel_read_safe": True}
