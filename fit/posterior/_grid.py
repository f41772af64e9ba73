"""The same posterior on a grid, for cross-checks and figures."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from fit.posterior._cells import Cells, check_few
from fit.posterior._model import parallax_model
from fit.posterior._priors import NoiseOptions, as_priors
from fit.posterior._sample import distances_of, posterior_equations
from fit.sampling import Prior
from fit.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import AxesArray, Cosmology, FloatArray, OnAxes, Table
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class GridPosterior(Result):
    """Probabilities on a grid of H0 and perhaps one more, with the velocity integrated exactly.

    Attributes
    ----------
    names : tuple of str
        H0, and peculiar_dispersion or excess_noise where free.
    axes : tuple of arrays
        Values of each.
    probability : array
        Probability of each point of the grid; sums to 1.
    velocity : Vector
        Mean and covariance of v. [km/s, toward the apex]
    """

    names: tuple[str, ...]
    axes: tuple
    probability: FloatArray
    velocity: Vector

    def report(self) -> str:
        """Means and standard deviations as text."""
        v = self.velocity
        lines = [f"Posterior on a grid ({v.frame} axes, velocity toward the apex)"]
        lines += [f"{name:22}{self.mean(name):.4g} ± {self.sigma(name):.2g}" for name in self.names]
        lines += [f"v_{axis:20}{x:+.1f} ± {s:.1f} km/s" for axis, x, s in zip("xyz", v.value, v.sigma, strict=True)]
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """Marginal probabilities as an astropy Table: for each quantity its values and their probabilities."""
        columns = {}
        for name in self.names:
            columns[name], columns[f"probability_{name}"] = self.marginal(name)
        return tables.table_of(columns, {"frame": self.velocity.frame})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Marginal densities, on matplotlib axes."""
        from fit.posterior._plot import plot_marginals

        return plot_marginals(self, ax=ax)

    def marginal(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Values and probabilities of the quantity `name`: two arrays."""
        index = self.names.index(name)
        others = tuple(i for i in range(len(self.names)) if i != index)
        return self.axes[index], self.probability.sum(others)

    def mean(self, name: str) -> float:
        """Posterior mean of the quantity `name`."""
        x, p = self.marginal(name)
        return float(x @ p)

    def sigma(self, name: str) -> float:
        """Posterior standard deviation of the quantity `name`."""
        x, p = self.marginal(name)
        return float(np.sqrt((x - x @ p) ** 2 @ p))


@arguments.accepts(field=arguments.a(Field, Parts), n_points=arguments.whole)
def grid(
    field: Field | Parts,
    velocity_prior: str | Vector | Callable[[FloatArray], FloatArray] | None = None,
    hubble_prior: str | tuple[float, float] | Prior | None = None,
    *,
    cosmology: Cosmology | None = None,
    n_points: int = 400,
    threads: int | None = None,
    **noise: Unpack[NoiseOptions],
) -> GridPosterior:
    """Evaluate the posterior on a grid of its non-linear parameters, at most two.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4.
    velocity_prior, hubble_prior : as in `Priors`, optional
        "planck" and "flat" unless given; the velocity's prior must be Gaussian or flat.
    cosmology : astropy cosmology, optional
        The shape of the distance.
    n_points : int
        Along each axis.
    threads : int, optional
        How many; one a core unless given.
    **noise
        The other attributes of `Priors`, but outliers; and `fit.secular_parallax.DistanceOptions`.

    Raises
    ------
    ParameterError
        If more than two numbers are free, or the velocity's prior is a function.
    """
    known = as_priors(velocity_prior, hubble_prior, dict(noise))
    if known.outliers is not None:
        raise ParameterError("a grid has no outliers: sample the posterior")
    rows, given = posterior_equations(field, known, cosmology, distances_of(dict(noise)))
    check_few(given)
    return of_cells(Cells.of(parallax_model(rows, given, known.spin, threads), n_points))


def of_cells(cells: Cells) -> GridPosterior:
    """What cells say."""
    weight, mean = cells.probability.ravel(), cells.mean
    centre = weight @ mean
    away = mean - centre
    spread = np.einsum("n,nij->ij", weight, cells.covariance) + np.einsum("n,ni,nj->ij", weight, away, away)
    velocity = Vector(centre, spread, cells.model.likelihood.frame, "km/s")
    return GridPosterior(tuple(cells.model.priors.free), cells.axes, cells.probability, velocity)
