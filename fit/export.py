"""A solution as files: report, tables with their provenance, figures."""

from pathlib import Path

import numpy as np

from vsh import tables


def write_solution(solution, path, meta=None):
    """Write the coefficients with names and errors as a table, provenance in its metadata.

    Parameters
    ----------
    solution : Solution
    path : str or Path — its ending tells the format (.ecsv)
    meta : dict, optional — provenance, plain values
    """
    modes = list(solution.modes)
    columns = {
        "coefficient": [str(mode) for mode in modes],
        "kind": [mode.kind for mode in modes],
        "l": [mode.l for mode in modes],
        "m": [mode.m for mode in modes],
        "part": [mode.part for mode in modes],
        "value": solution.coefficients.values,
        "sigma": solution.sigma,
    }
    own = {
        "lmax": solution.modes.lmax,
        "frame": solution.frame,
        "chi2": float(solution.chi2),
        "n_data": int(solution.n_data),
        "dof": int(solution.dof),
        "notes": [str(note) for note in solution.notes],
        "errors_from": solution.errors_from,
    }
    tables.write(path, columns, own | (meta or {}), dict.fromkeys(("value", "sigma"), "uas / yr"))


def write_correlation(solution, path, meta=None):
    """Write the correlation matrix as a table, a row and a column for each coefficient."""
    names = [str(mode) for mode in solution.modes]
    columns = {"coefficient": names} | dict(zip(names, np.asarray(solution.correlation)))
    tables.write(path, columns, meta)


def write_figures(solution, field, folder):
    """Draw the sky, the spectrum, the correlations and the residuals as PNG; returns their paths."""
    import matplotlib.pyplot as plt

    from fit.plot import plot_correlation, plot_residuals, plot_spectrum
    from vsh.plot import plot_field

    folder = Path(folder)
    figures = {
        "sky.png": plot_field(field, solution.coefficients),
        "spectrum.png": plot_spectrum(solution),
        "correlation.png": plot_correlation(solution),
        "residuals.png": plot_residuals(solution, field),
    }
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=150)
        plt.close(figure)
    return [folder / name for name in figures]
