"""Where our modules are: by the names of the release before this one, too, and beside a user's own `fit.py`.

The packages of the project are four, vsh, sim, fit and study. A file or folder of one of these names in the folder of a
script comes first in Python's search, and hides ours.
"""

import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec, module_from_spec
from typing import Any

import lazy_loader

#: Beside vsh.
_OTHERS = ("sim", "fit", "study")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def hidden() -> dict[str, str]:
    """What hides a package of ours: its place, by the package's name."""
    hiding = {}
    for name in _OTHERS:
        try:
            spec = sys.modules[name].__spec__ if name in sys.modules else find_spec(name)
        except (ImportError, ValueError, AttributeError):
            continue  # a module without a specification, made by hand
        if spec is None:
            continue  # it is not installed
        places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
        if places and not any(_is_ours(place, name) for place in places):
            hiding[name] = places[0]
    return hiding


def _is_ours(place, name):
    return os.path.realpath(place).startswith(os.path.realpath(os.path.join(_ROOT, name)) + os.sep)


def warn_if_hidden() -> None:
    """Warn in one sentence where something of the user's hides a package of ours."""
    if os.path.dirname(sys.argv[0]) == os.path.join(_ROOT, "vsh") or sys.argv[:1] == ["-m"]:
        return  # `python -m vsh` finds ours whatever hides them
    for name, place in hidden().items():
        from vsh.tools.errors import VshWarning  # NumPy comes with it

        warnings.warn(
            f"{place} hides the package {name} of vsh-astrometry, so that `import {name}` gives yours: rename it, or "
            "run from another folder",
            VshWarning,
            stacklevel=3,
        )


def import_ours() -> None:
    """Import our packages where something of the user's hides them: commands do not depend on the folder."""
    for name in hidden():
        spec = PathFinder.find_spec(name, [_ROOT])
        if spec is not None and spec.loader is not None:
            sys.modules[name] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])


#: Modules by their old names. They go with the next release.
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
    "vsh.sky.redshift_frames": "vsh.sky.frames",
    "vsh.system": "vsh.tools",
    "vsh.tables": "vsh.io.tables",
    "vsh.units": "vsh.tools.units",
    "vsh.waves": "vsh.models.waves",
    "fit.check": "fit.frame",
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
        return None if new_name(name) is None else ModuleSpec(name, _Finder)  # type: ignore[arg-type]  # a class will do

    @staticmethod
    def create_module(spec):
        return None

    @staticmethod
    def exec_module(module):
        new = new_name(module.__name__) or module.__name__
        warn(module.__name__, new)
        sys.modules[module.__name__] = import_module(new)


def warn(old: str, new: str) -> None:
    """Warn whoever imports or asks for something by its old name."""
    warnings.warn(f"{old} is now {new}; the old name goes with the next release", DeprecationWarning, stacklevel=3)


def install() -> None:
    """Let modules be imported by their old names, too."""
    if _Finder not in sys.meta_path:
        sys.meta_path.append(_Finder)


def old_names(
    module: str, renamed: Mapping[str, str | tuple[str, str]], otherwise: Callable[[str], Any] | None = None
) -> Any:
    """A module's `__getattr__`: what goes by other names now, and whatever else it gives.

    `renamed` has the new names by the old: of the same module, or with a module before them; or what still answers to
    the old name, and what to use instead.
    """

    def getattribute(name):
        if name in renamed:
            known = renamed[name]
            new, instead = known if isinstance(known, tuple) else (known, "")
            home, _, attribute = new.rpartition(".")
            warn(f"{module}.{name}", instead or (new if home else f"{module}.{new}"))
            return getattr(import_module(home or module), attribute)
        if otherwise is not None:
            try:
                return otherwise(name)
            except AttributeError as error:
                from vsh.tools.errors import no_name

                raise no_name(module, name, dir(sys.modules[module]), error) from None
        from vsh.tools.errors import no_name

        missing = AttributeError(f"module {module!r} has no attribute {name!r}")
        raise no_name(module, name, dir(sys.modules[module]), missing)

    return getattribute


def lazily(
    module: str, names: Sequence[str], attributes: Mapping[str, list[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """A face's `__getattr__` and `__dir__`: attributes of its files, or sub-modules, imported when first asked for."""
    submodules = () if attributes else names
    attached, _, _ = lazy_loader.attach(module, submodules=submodules, submod_attrs=dict(attributes))

    def get(name):
        try:
            return attached(name)
        except AttributeError as error:
            from vsh.tools.errors import no_name

            raise no_name(module, name, list(names), error) from None

    return get, lambda: list(names)
