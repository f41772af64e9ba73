"""What every command does alike, and the list of the commands."""

from typing import NamedTuple


class Command(NamedTuple):
    """A row of `COMMANDS`."""

    #: The module of `vsh.commands.options` with its parser.
    options: str
    #: The module whose `run(options)` does the work.
    module: str
    #: Keys of citations.bib: what it rests on whatever it is asked.
    cites: tuple[str, ...]


_FIT = ("mignard2012", "ducc")
_PIXELS = ("gorski2005", "zonca2019")

#: The commands by name, without their `vsh-`.
COMMANDS = {
    "fit": Command("fit", "fit.commands.fit", (*_FIT, "lindegren2012", "bachchan2016")),
    "redshift": Command("redshift", "fit.commands.redshift", (*_FIT, "bachchan2016", "planck2020parameters")),
    "correlate": Command("correlate", "fit.commands.correlate", (*_FIT, "bachchan2016")),
    "pairs": Command("pairs", "fit.commands.pairs", (*_FIT, *_PIXELS, "book2011")),
    "compare": Command("compare", "fit.commands.compare", (*_FIT, "charlot2020")),
    "link": Command("link", "fit.commands.link", (*_FIT, "lindegren2020")),
    "sim": Command("simulate", "sim.commands.simulate", ("bachchan2016",)),
    "agis": Command("agis", "sim.commands.agis", ("lindegren2012", "bachchan2016", "lam2015", *_PIXELS, *_FIT)),
    "study": Command("study", "study.command", (*_FIT, "bachchan2016")),
    "referee": Command("referee", "study.referee.command",
                       (*_FIT, *_PIXELS, "gaia2021acceleration", "book2011", "nguyen2026")),
    "forecast": Command("forecast", "study.forecast.command",
                        (*_FIT, "bachchan2016", "book2011", "planck2020overview", "planck2020parameters")),
    "waves": Command("waves", "study.waves", (*_FIT, *_PIXELS, "book2011", "lindegren2012")),
    "archive": Command("archive", "vsh.commands.archive", ("gaia2016",)),
}  # fmt: skip
