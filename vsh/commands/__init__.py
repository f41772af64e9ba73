"""What every command does alike, and the list of the commands."""

from typing import NamedTuple


class Command(NamedTuple):
    """A row of `COMMANDS`."""

    #: The module with its parser, `make_parser()`, and with `run(options)`, which does the work.
    module: str
    #: Keys of citations.bib: what it rests on whatever it is asked.
    cites: tuple[str, ...]


_FIT = ("mignard2012", "ducc")
_PIXELS = ("gorski2005", "zonca2019")

#: The commands by name, without their `vsh-`.
COMMANDS = {
    "fit": Command("fit.commands.fit", (*_FIT, "lindegren2012", "bachchan2016")),
    "redshift": Command("fit.commands.redshift", (*_FIT, "bachchan2016", "planck2020parameters")),
    "correlate": Command("fit.commands.correlate", (*_FIT, "bachchan2016")),
    "pairs": Command("fit.commands.pairs", (*_FIT, *_PIXELS, "book2011")),
    "compare": Command("fit.commands.compare", (*_FIT, "charlot2020")),
    "link": Command("fit.commands.link", (*_FIT, "lindegren2020", "lunz2023", "zhang2025")),
    "sim": Command("sim.commands.simulate", ("bachchan2016",)),
    "referee": Command("study.commands.referee",
                       (*_FIT, *_PIXELS, "gaia2021acceleration", "book2011", "nguyen2026")),
    "forecast": Command("study.commands.forecast",
                        (*_FIT, "bachchan2016", "book2011", "planck2020overview", "planck2020parameters")),
    "waves": Command("study.commands.waves", (*_FIT, *_PIXELS, "book2011", "lindegren2012")),
    "archive": Command("vsh.commands.archive", ("gaia2016",)),
}  # fmt: skip
