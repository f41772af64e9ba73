"""The reference: `api/index.md` lists the promised names by task in tables, and each name has a page of its own.

A block `.. automodule:: M` with `:members:` becomes a table of these names, each with the first line of its docstring and
a link to `api/one/M.name`, which has the whole docstring, what it returns, and the examples of the gallery that use it.
Names of the project that are written in backticks, in docstrings and on pages, become links to these pages.
"""

import importlib
import inspect
import re
import shutil
from pathlib import Path

from docutils import nodes
from numpydoc import xref
from sphinx.addnodes import pending_xref

_BLOCK = re.compile(r"\.\. automodule:: ([\w.]+)\n((?:   :[^\n]*\n)*)")
_NAME = re.compile(r"((?:vsh|fit|sim|study)\.[\w.]*\w)(?:\(.*\))?")


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


def say_what_is_returned(what, thing, lines):
    """A section "Returns" from the annotation, where a docstring has none of its own."""
    if what not in ("function", "method") or "Returns" in lines or "Yields" in lines:
        return
    try:
        given = inspect.signature(thing).return_annotation
    except (TypeError, ValueError):
        return
    if given is inspect.Signature.empty or given in (None, "None"):
        return
    said = given if isinstance(given, str) else inspect.formatannotation(given)
    said = re.sub(r"\b\w*Array\b(?:\[[^\]]*\])?", "ndarray", said.strip("'\""))
    said = re.sub(r"\b(?:[a-z_]\w*\.)+(?=[A-Z])", "", said).replace(" | ", " or ").replace("'", "")
    lines += ["", "Returns", "-------", said, ""]


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


def file_name(module, name):
    """Of the page of a name: `Floor` and `floor` differ where file names ignore case."""
    thing = getattr(importlib.import_module(module), name)
    return f"{module}.{name}-class" if inspect.isclass(thing) else f"{module}.{name}"


def name_classes(app, config):
    """Where each class that is named as a type has its page."""
    xref.DEFAULT_LINKS.clear()  # Python's own words, whose inventory is not there without a network
    config.numpydoc_xref_aliases = {
        "ndarray": "numpy.ndarray",
        "Axes": "matplotlib.axes.Axes",
        "Table": "astropy.table.Table",
    }
    for module, options in _BLOCK.findall((Path(app.srcdir) / "api" / "index.md").read_text(encoding="utf-8")):
        for name in names_of(module, options):
            if inspect.isclass(getattr(importlib.import_module(module), name)):
                config.numpydoc_xref_aliases[name] = f"{module}.{name}"


def write_pages(app):
    """A page for every name, anew each time."""
    one = Path(app.srcdir) / "api" / "one"
    shutil.rmtree(one, ignore_errors=True)
    one.mkdir()
    for module, options in _BLOCK.findall((Path(app.srcdir) / "api" / "index.md").read_text(encoding="utf-8")):
        for name in names_of(module, options):
            full = f"{module}.{name}"
            thing = getattr(importlib.import_module(module), name)
            directive, more = directive_of(thing)
            if shown := re.search(":show: (.+)", options):  # of a class of matplotlib's, what is ours
                more = [f"members: {shown[1]}", "no-inherited-members:"]
            kind = "class" if inspect.isclass(thing) else "function" if callable(thing) else "constant"
            lines = [
                full, "=" * len(full), "", f"A {kind} of the :doc:`reference </api/index>`.", "",
                f".. {directive}:: {full}", *(f"   :{option}" for option in more), "",
                f".. minigallery:: {full}", "   :add-heading: Examples that use it", "   :heading-level: -", "",
            ]  # fmt: skip
            (one / f"{file_name(module, name)}.rst").write_text("\n".join(lines), encoding="utf-8")


def as_tables(app, docname, source):
    """Blocks of a page as tables of what is on pages of their own."""
    if docname != "api/index":
        return
    seen = set()

    def table(block):
        module, options = block.groups()
        names = names_of(module, options)
        head = f".. py:module:: {module}\n\n" if module not in seen else ""
        if module not in seen and ":no-index:" not in options:
            lines = [inspect.getdoc(importlib.import_module(module)).splitlines()[0]]
            escape(lines)
            head += lines[0] + "\n\n"
        seen.add(module)
        rows = "".join(f"   {name}\n" for name in names)
        pages = "".join(f"   {name} <one/{file_name(module, name)}>\n" for name in names)
        return (
            f"{head}.. py:currentmodule:: {module}\n\n.. autosummary::\n   :nosignatures:\n\n{rows}\n"
            f".. toctree::\n   :hidden:\n\n{pages}"
        )

    source[0] = _BLOCK.sub(table, source[0])


def link_names(app, doctree):
    """Names of the project in the code of a page as links; what is no name stays as it is."""
    if app.env.docname.startswith(("gallery/", "learn/")):
        return
    for literal in list(doctree.findall(nodes.literal)):
        found = _NAME.fullmatch(literal.astext())
        if found is None or isinstance(literal.parent, (nodes.reference, pending_xref)):
            continue
        link = pending_xref(
            "",
            refdomain="py",
            reftype="obj",
            reftarget=found[1],
            refdoc=app.env.docname,
            refwarn=False,
            refexplicit=True,
        )
        literal.replace_self(link)
        link += literal


def find_name(app, env, node, contnode):
    """What a name without its module means, where a single promised name ends with it."""
    if node.get("refdomain") != "py" or node.get("reftype") not in ("obj", "class", "func", "exc", "data"):
        return None
    target = node["reftarget"].lstrip(".")
    domain = env.get_domain("py")
    things = {
        full: each for full, each in domain.objects.items()
        if (full == target or full.endswith(f".{target}")) and (each.objtype not in ("method", "attribute", "property") or "." in target)
    }  # fmt: skip
    if len(things) != 1:
        named = target.rsplit(".", 1)[-1]
        things = {full: each for full, each in domain.objects.items()
                  if full.rsplit(".", 1)[-1] == named and each.objtype in ("function", "class", "exception", "data")
                  and full.split(".")[0] == target.split(".")[0]} if "." in target else {}  # fmt: skip
    if len(things) != 1:
        return None
    ((_, found),) = things.items()
    from sphinx.util.nodes import make_refnode

    return make_refnode(app.builder, node["refdoc"], found.docname, found.node_id, contnode, target)


def setup(app):
    """Tables in place of members, a page for each, and links."""
    app.setup_extension("sphinx.ext.autosummary")
    app.connect("config-inited", name_classes, priority=100)  # before numpydoc reads them
    app.connect("builder-inited", write_pages)
    app.connect("source-read", as_tables)
    app.connect("doctree-read", link_names)
    app.connect("missing-reference", find_name)
    app.connect("autodoc-process-docstring", lambda app, what, name, thing, options, lines: (
        escape(lines), say_what_is_returned(what, thing, lines)), priority=100)  # fmt: skip
    return {"parallel_read_safe": True}
