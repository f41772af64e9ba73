"""Whom to cite for a run: BibTeX of ours, and of the methods and libraries that it uses."""

import re
from collections.abc import Mapping
from typing import Any

import vsh
from vsh.commands import COMMANDS

_ALWAYS = ("vsh_astrometry", "harris2020", "virtanen2020", "astropy2022")
_PIXELS = ("gorski2005", "zonca2019")
#: What a run uses where it is asked for something, besides what its command rests on.
_OPTIONS = {
    "posterior": ("foremanmackey2013", "foremanmackey2016", "planck2020overview"),
    "waves": ("book2011",),
    "floor": ("lindegren2021",),
    "classes": ("lindegren2021",),
    "templates": ("lindegren2021", "nguyen2026"),
    "jackknife": _PIXELS,
    "influence": _PIXELS,
    "selection": _PIXELS,
    "gaia": ("gaia2016", "gaia2021acceleration", "gaia2022crf3", *_PIXELS),
    "workers": ("rocklin2015",),
    "scheduler": ("rocklin2015",),
    "output": ("hunter2007",),
    "html": ("hunter2007",),
}
#: Options that write what may hold figures.
_WRITES = ("output", "html")
#: The same for values of options.
_VALUES = {
    "planck": ("planck2020overview",),
    "student": ("lange1989",),
    "permissive": ("sivia2006",),
    "crf3": ("gaia2016", "gaia2022crf3"),
    "gaia-crf3": ("gaia2022crf3",),
    "gaia-edr3-qso": ("gaia2022crf3",),
    "solved": ("lindegren2012", "lam2015"),
}


def keys(command: str, given: Mapping[str, Any]) -> list[str]:
    """The keys of what a run uses, ours first."""
    works = [*_ALWAYS, *COMMANDS[command.removeprefix("vsh-")].cites]
    draws = "no-figures" not in given and command not in ("vsh-sim", "vsh-archive")
    for name, value in given.items():
        works += _OPTIONS.get(name, ()) if draws or name not in _WRITES else ()
        works += _VALUES.get(value, ()) if isinstance(value, str) else ()
    return list(dict.fromkeys(works))


def bibtex(command: str, given: Mapping[str, Any]) -> str:
    """The entries of what a run uses."""
    from importlib.resources import files

    text = (
        files("vsh.commands").joinpath("citations.bib").read_text(encoding="utf-8").replace("VERSION", vsh.__version__)
    )
    entries = dict(re.findall(r"^(?=@\w+\{(\w+),)(.*?^\}$)", text, re.MULTILINE | re.DOTALL))
    return "\n\n".join(entries[key] for key in keys(command, given))
