"""Names of the release before this one: they still work, and say what they are called now."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.machinery import ModuleSpec
from typing import Any

#: Modules by their old names. To be removed with the release after next.
MODULES = {
    "vsh.archive": "vsh.io.archive",
    "vsh.catalogue": "vsh.io.catalogue",
    "vsh.checks": "vsh.tools",
    "vsh.cosmology": "vsh.models.cosmology",
    "vsh.covariance": "vsh.models.covariance",
    "vsh.epochs": "vsh.io.epochs",
    "vsh.errors": "vsh.tools.errors",
    "vsh.flows": "vsh.models.flows",
    "vsh.page": "vsh.figures.page",
    "vsh.parts": "vsh.io.parts",
    "vsh.plot": "vsh.figures.plot",
    "vsh.system": "vsh.tools",
    "vsh.tables": "vsh.io.tables",
    "vsh.units": "vsh.tools.units",
    "vsh.waves": "vsh.models.waves",
    "fit.harmonic": "fit.solution",
    "fit.linear": "fit.solution",
}


def new_name(module: str) -> str | None:
    """What a module is called now; None where it was not renamed."""
    for old, new in MODULES.items():
        if module == old or module.startswith(old + "."):
            return new + module[len(old) :]
    return None


class _Finder:
    """Finds a module under its old name; an import then gives the module itself, and a warning."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        return None if new_name(name) is None else ModuleSpec(name, _Finder)

    @staticmethod
    def create_module(spec):
        return None

    @staticmethod
    def exec_module(module):
        new = new_name(module.__name__)
        warn(module.__name__, new)
        sys.modules[module.__name__] = import_module(new)


def warn(old: str, new: str) -> None:
    """Warn whoever imports or asks for something by its old name."""
    warnings.warn(f"{old} is now {new}; the old name goes with the next release", DeprecationWarning, stacklevel=3)


def install() -> None:
    """Let modules be imported by their old names, too."""
    if _Finder not in sys.meta_path:
        sys.meta_path.append(_Finder)


def old_names(module: str, renamed: Mapping[str, str], otherwise: Callable[[str], Any] | None = None) -> Any:
    """A module's `__getattr__`: what goes by other names now, and whatever else it gives.

    `renamed` has the new names by the old: of the same module, or with a module before them.
    """

    def getattribute(name):
        if name in renamed:
            new = renamed[name]
            home, _, attribute = new.rpartition(".")
            warn(f"{module}.{name}", new if home else f"{module}.{new}")
            return getattr(import_module(home or module), attribute)
        if otherwise is not None:
            return otherwise(name)
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return getattribute
