"""`vsh-pairs`: the correlation of motions by angle, on the command line."""

from pathlib import Path
from typing import Any

import numpy as np

from vsh.commands import finishing, outputs, reading, running
from vsh.commands.options import pairs as options_module


def _run(options):
    outputs.check(options)
    source = reading.open_catalogue(options.catalogue, options)
    from fit import pairs
    from vsh.io import catalogue

    field: Any
    if reading.in_parts(options):
        field = catalogue.parts(options.catalogue, **reading.reading_parts(options)).to_frame(options.frame)
    else:
        field = catalogue.read_field(source, roles=(), **reading.arguments(options)).to_frame(options.frame)
    edges = np.radians(np.linspace(0, options.up_to, options.bins + 2))
    correlation = pairs.correlation_function(field, edges, lmax=options.lmax, nside=options.nside)
    fitted = correlation.fit(options.templates) if options.templates else None
    power = pairs.power(field, options.powers, nside=options.nside) if options.powers else None

    def text(long):  # the lines to quote have the limits of the templates
        return "\n".join([each.report() for each in (correlation, long and fitted, power) if each])

    tabled = {"Correlation by angle": correlation, "Templates": fitted, "Power by degree": power}
    finishing.finish(
        options,
        finishing.RunResult(
            text,
            lambda: {name: each.to_table() for name, each in tabled.items() if each},
            correlation.notes,
            answer=[("templates", fitted.verdict)] if fitted else [],
        ),
        provenance=lambda: running.provenance(options.catalogue, options, sources=correlation.n_data // 2),
        draw=lambda: _draw(correlation, fitted, power),
        write=lambda folder, meta: _write(folder, correlation, fitted, power, meta),
        title=f"Pairs of {Path(options.catalogue).name}",
    )


def _write(folder, correlation, fitted, power, meta):
    correlation.write(folder / "pairs.ecsv", meta)
    if fitted is not None:
        fitted.write(folder / "templates.ecsv", meta)
    if power is not None:
        power.write(folder / "power.ecsv", meta)


def _draw(correlation, fitted, power):
    return {"pairs": correlation.plot(fitted)} | ({} if power is None else {"power": power.plot()})


main, run = running.make_entry(options_module, _run)
