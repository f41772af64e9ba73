"""Many skies as a few numbers each, for inference that has simulations in place of a likelihood.

A simulated sky is compressed to the least-squares coefficients of each class of sources, which are all that a Gaussian
likelihood knows of it, and to the reduced χ² of each class, which tells how wrong the errors are. Both are linear or
quadratic in the motions, with weights that are the same for every sky.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from fit.normal import normal_equations
from fit.solving import solve
from vsh.basis import harmonics
from vsh.classes import Classes
from vsh.field import Field, multiply_weights
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.types import FloatArray, Rng

#: From a Generator to the parameters of a sky, (k,), and its motions with their noise, (2, n) [µas/yr].
Draw = Callable[[np.random.Generator], tuple[FloatArray, FloatArray]]


class SkyStatistics(InNotebook):
    """Statistics of the motions of given sources: coefficients and reduced χ² of each class.

    Parameters
    ----------
    field : Field
        Sources with the errors of their motions; the motions themselves are not used.
    lmax : int or Modes
        The highest degree.
    classes : Classes, optional
        Classes of the sources, with masks; all in one unless given.

    Attributes
    ----------
    names : tuple of str
        Names of the statistics.

    Raises
    ------
    DegeneracyError
        If a class does not determine the coefficients.
    ParameterError
        If a class has no sources.
    """

    def __init__(self, field: Field, lmax: int | Modes = 3, classes: Classes | None = None) -> None:
        self.modes, self.n_sources = as_modes(lmax), len(arguments.a(Field)("field", field))
        labelled = [("", np.ones(len(field), bool))] if classes is None else list(classes)
        self._parts: list[tuple[Any, FloatArray, FloatArray, FloatArray]] = []
        names: list[str] = []
        for label, mask in labelled:
            chosen = field[mask]
            if not len(chosen):
                raise ParameterError(f"the class {label!r} has no sources")
            basis = harmonics(chosen.lon, chosen.lat, self.modes)
            weighted = multiply_weights(chosen.weights, basis).reshape(len(self.modes), -1)
            inverse = solve(normal_equations(chosen, self.modes)).covariance
            self._parts.append((mask, weighted, inverse, chosen.weights))
            names += [f"{mode}{label and f' ({label})'}" for mode in self.modes]
            names.append(f"reduced χ²{label and f' ({label})'}")
        self.names = tuple(names)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"<SkyStatistics: {len(self)} of {self.n_sources} sources in {len(self._parts)} classes>"

    def __call__(self, motion: FloatArray) -> FloatArray:
        """Compute the statistics of motions, (2, n): coefficients [µas/yr] and reduced χ² of each class, (q,)."""
        values: list[FloatArray] = []
        for mask, weighted, inverse, weights in self._parts:
            own = motion[:, mask]
            rhs = weighted @ own.ravel()
            coefficients = inverse @ rhs
            chi2 = np.sum(own * multiply_weights(weights, own)) - rhs @ coefficients
            values += [coefficients, np.array([chi2 / (own.size - len(rhs))])]
        return np.concatenate(values)


def simulate_skies(
    draw: Draw, statistics: SkyStatistics, n: int, rng: Rng, *, threads: int | None = None, progress: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Simulate skies and keep their parameters and statistics.

    Parameters
    ----------
    draw : function
        From a Generator to the parameters of a sky, (k,), drawn from their prior, and the motions of its sources with
        all that is wrong with them, (2, n) [µas/yr].
    statistics : SkyStatistics
        What is kept of the motions.
    n : int
        Number of skies.
    rng : Generator or int
        The source of all randomness; each sky has a stream of its own, whatever the number of threads.
    threads : int, optional
        One a core unless given.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    parameters : (n, k) array
    statistics : (n, q) array
        In the order of `statistics.names`.

    Raises
    ------
    ParameterError
        If motions are not those of the sources.

    Examples
    --------
    >>> import sim
    >>> quasars = sim.quasars(500, 1)
    >>> field = sim.observe(quasars, sim.spin((0, 0, 0)), 1, sigma=50.0)
    >>> def draw(rng):
    ...     glide = rng.uniform(-10, 10, 3)
    ...     return glide, sim.acceleration(glide)(field.lon, field.lat) + 50 * rng.standard_normal((2, 500))
    >>> parameters, values = simulate_skies(draw, SkyStatistics(field, 2), 4, 1)
    >>> parameters.shape, values.shape
    ((4, 3), (4, 17))
    """
    arguments.a(SkyStatistics)("statistics", statistics)
    streams = arguments.generator(rng).spawn(arguments.whole("n", n))

    def simulate(block):
        rows = []
        for stream in streams[block]:
            parameters, motion = draw(stream)
            motion = np.asarray(motion, float)
            if motion.shape != (2, statistics.n_sources):
                raise ParameterError(f"a sky has motions of shape (2, {statistics.n_sources}), not {motion.shape}")
            rows.append((np.asarray(parameters, float), statistics(motion)))
        return rows

    bar = "skies" if progress else None
    rows = [row for block in map_blocks(simulate, len(streams), 4, threads, bar) for row in block]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
