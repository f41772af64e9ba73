"""`vsh-forecast`: forecast what future catalogues will measure, on the command line."""

import argparse

from vsh.commands import finishing, parsing, reading, running
from vsh.tools.errors import VshError


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of the command's options."""
    parser = parsing.make_parser(
        prog="vsh-forecast",
        description=(
            "Forecast uncertainties of spin, acceleration, R0, gravitational waves, shear, our velocity and H0 for "
            "Gaia DR3, DR4, DR5, DR5 with positions of Euclid, Roman or Rubin, a successor in the near infrared, VLBI, "
            "the SKA, and your own survey."
        ),
        examples=(
            "vsh-forecast",
            'vsh-forecast --only "Gaia DR4" --output forecast',
            'vsh-forecast --only "Gaia DR4" --survey mine=5000,3.0',
        ),
    )
    add = parsing.adder(parser)
    add("--only NAME,…", "names of known surveys (default: all); may be repeated", _split_survey_names, action="append")
    add(
        "--survey NAME=N,SIGMA",
        "a survey of your own: number of quasars, and error of their motions in µas/yr; may be repeated",
        _parse_survey_option,
        action="append",
    )
    add(
        "--sky",
        "distribution of quasars on the sky: uniform, gums (no Galactic plane) or igql (known quasars)",
        ("uniform", "gums", "igql"),
        "uniform",
    )
    add("--no-flows", "omit velocity and H0 from fits with flows as unknowns")
    reading.add_output(parser)
    return parsing.add_common(parser)


def _split_survey_names(text):
    return tuple(name.strip() for name in text.split(","))


def _parse_survey_option(text):
    name, _, numbers_text = text.partition("=")
    try:
        n_quasars, sigma = parsing.parse_numbers(numbers_text)
    except (ValueError, argparse.ArgumentTypeError):
        n_quasars, sigma = 0.5, 0.0
    if not name.strip() or n_quasars < 1 or n_quasars != int(n_quasars) or not sigma > 0:
        raise argparse.ArgumentTypeError(
            f"expected NAME=N,SIGMA, with N a whole number and SIGMA an error in µas/yr, not {text!r}"
        )
    return name.strip(), int(n_quasars), sigma


def _run(options):
    run = finishing.Run(options)
    from study.forecast import SURVEYS, Survey, forecast_surveys

    surveys = dict(SURVEYS)
    selected_names = [name for names in options.only or () for name in names]
    for name in selected_names:
        if name not in surveys:
            raise VshError(f"no survey is called {name!r}; known surveys are {', '.join(surveys)}")
    surveys = {name: surveys[name] for name in selected_names or surveys}
    for name, n_quasars, sigma in options.survey or ():
        surveys[name] = Survey(n_quasars, sigma=sigma, says="as given")
    forecast = forecast_surveys(surveys, sky=options.sky, flows=not options.no_flows)
    run.finish(
        [finishing.Part("forecast", forecast, "Expected errors", as_table=True)],
        answer=forecast.answer,
        title="What future catalogues will measure",
    )


main, run = running.make_entry(__name__, _run)
