"""`vsh-forecast`: what catalogues to come will tell, on the command line."""

from vsh.commands import finishing, outputs, running
from vsh.commands.options import forecast as options_module
from vsh.tools.errors import VshError


def _run(options):
    outputs.check(options)
    from study.forecast import SURVEYS, Survey, forecast_surveys

    surveys = dict(SURVEYS)
    for name in options.only or ():
        if name not in surveys:
            raise VshError(f"no survey is called {name!r}: {', '.join(surveys)} are")
    surveys = {name: surveys[name] for name in options.only or surveys}
    for name, (n, sigma) in (options.survey or {}).items():
        surveys[name] = Survey(n, sigma=sigma, says="as given")
    forecast = forecast_surveys(surveys, sky=options.sky, flows=not options.no_flows)
    finishing.finish(
        options,
        finishing.RunResult(
            lambda long: forecast.report(long=long),
            lambda: {"Errors to come": forecast.to_table()},
            answer=forecast.answer,
        ),
        provenance=lambda: running.provenance([], options),
        draw=lambda: {"forecast": forecast.plot()},
        write=lambda folder, meta: _write(folder, forecast, meta),
        title="What catalogues to come will tell",
    )


def _write(folder, forecast, meta):
    from vsh.io import tables

    tables.write_table(forecast.to_table(), folder / "forecast.ecsv", meta)


main, run = running.make_entry(options_module, _run)
