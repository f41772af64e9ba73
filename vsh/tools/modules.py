"""Where our modules are, beside a user's own `fit.py` too, and what their packages show.

The packages of the project are four, vsh, sim, fit and study. A file or folder of one of these names in the folder of a
script comes first in Python's search, and hides ours.
"""

import os
import re
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pkgutil import resolve_name
from typing import Any

import lazy_loader

#: Beside vsh.
_OTHER_PACKAGES = ("sim", "fit", "study")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def find_shadowed_packages() -> dict[str, str]:
    """Modules that hide our packages: their places, by name."""
    hiding_paths = {}
    for name in _OTHER_PACKAGES:
        try:
            spec = sys.modules[name].__spec__ if name in sys.modules else find_spec(name)
        except (ImportError, ValueError, AttributeError):
            continue  # a module without a specification, made by hand
        if spec is None:
            continue  # it is not installed
        paths = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
        if paths and not any(_is_our_package(path, name) for path in paths):
            hiding_paths[name] = paths[0]
    return hiding_paths


def _is_our_package(path, name):
    return os.path.realpath(path).startswith(os.path.realpath(os.path.join(_ROOT, name)) + os.sep)


def warn_if_packages_hidden() -> None:
    """Warn in one sentence where something of the user's hides a package of ours."""
    if os.path.dirname(sys.argv[0]) == os.path.join(_ROOT, "vsh") or sys.argv[:1] == ["-m"]:
        return  # `python -m vsh` finds ours whatever hides them
    for name, path in find_shadowed_packages().items():
        from vsh.tools.errors import VshWarning  # NumPy comes with it

        warnings.warn(
            f"{path} hides the package {name} of vsh-astrometry, so that `import {name}` gives yours: rename it, or "
            "run from another folder",
            VshWarning,
            stacklevel=3,
        )


def import_hidden_packages() -> None:
    """Import our packages where something of the user's hides them: commands do not depend on the folder."""
    for name in find_shadowed_packages():
        spec = PathFinder.find_spec(name, [_ROOT])
        if spec is not None and spec.loader is not None:
            sys.modules[name] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])


def lazy_names_from_stub(module: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose names stand in its stub.

    Errors and warnings are not listed by `dir`: whoever looks for a function need not read past them.
    """
    getter, _, names = lazy_loader.attach_stub(module, file)
    dir_names = sorted(name for name in names if not name.endswith(("Error", "Warning")))
    return _make_hinting_getattr(module, getter, names), lambda: list(dir_names), names


def lazy_names(
    module: str, names: Sequence[str], attributes: Mapping[str, list[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """A face's `__getattr__` and `__dir__`: attributes of its files, or sub-modules, imported when first asked for."""
    submodules = () if attributes else names
    getter, _, _ = lazy_loader.attach(module, submodules=submodules, submod_attrs=dict(attributes))

    return _make_hinting_getattr(module, getter, list(names)), lambda: list(names)


def hint_missing_names(module: str, names: list[str]) -> Callable[[str], Any]:
    """A `__getattr__` of a module with these names, whose error names what may be meant."""

    def refuse(name: str) -> None:
        raise AttributeError(f"module {module!r} has no attribute {name!r}", name=name)

    return _make_hinting_getattr(module, refuse, names)


def _make_hinting_getattr(module, getter, names):
    """A `__getattr__` whose error names what may be meant."""

    def get_or_hint(name):
        try:
            return getter(name)
        except AttributeError as error:
            if name in names:  # an import of ours failed, and its cause is what helps
                raise
            from vsh.tools.errors import NAMES, missing_name_error

            if re.fullmatch(r"\w+(\.\w+)+", NAMES.get(name, "")):  # another name for one of ours
                return resolve_name(NAMES[name])
            raise missing_name_error(module, name, names, error) from None

    return get_or_hint
