"""A chain and what it says of our velocity and the Hubble constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fit.posterior._mixture import MixtureModel
from fit.posterior._model import ParallaxModel
from fit.posterior._summary import SampleResult, Samples, text_of
from fit.sampling import autocorrelation
from vsh.errors import ConvergenceError
from vsh.system.quiet import import_quietly
from vsh.types import Figure, FloatArray, PathName

#: A chain shorter than this many autocorrelation times says nothing certain, not even about its length.
ENOUGH = 50


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(SampleResult):
    """A chain and what it says.

    Attributes
    ----------
    chain : (steps, walkers, d) array
        All of it, in the coordinates of the sampler.
    log_probability : (steps, walkers) array
    model : ParallaxModel or MixtureModel
    frame : str
        Of velocity and acceleration.
    notes : tuple of str
    seed : int
    """

    chain: FloatArray
    log_probability: FloatArray
    model: ParallaxModel | MixtureModel
    frame: str
    notes: tuple[str, ...]
    seed: int

    def __repr__(self) -> str:
        steps, walkers, _ = self.chain.shape
        return f"<Posterior: {steps} steps of {walkers} walkers, {', '.join(self.model.names)}, {self.frame}>"

    @cached_property
    def autocorrelation(self) -> dict[str, float]:
        """Integrated autocorrelation time of each coordinate, by name. [steps]"""
        times = autocorrelation(self.chain)
        return dict(zip(self.model.names, map(float, times)))

    @property
    def burn_in(self) -> int:
        """Steps left out at the start: five autocorrelation times of the slowest coordinate."""
        return int(np.ceil(5 * self._slowest()))

    @property
    def thinning(self) -> int:
        """The thinning interval, in steps: half the autocorrelation time of the quickest."""
        return max(1, int(min(self.autocorrelation.values()) / 2))

    @cached_property
    def samples(self) -> dict[str, FloatArray]:
        """Samples after burn-in and thinning, by name: arrays (n,).

        v_x, v_y, v_z and speed [km/s, toward the apex, along the axes of `frame`]; H0
        [km/s/Mpc]; a_x, a_y, a_z [µas/yr]; and what else was free: peculiar_dispersion [km/s],
        excess_noise [µas/yr], outlier_fraction.

        Raises
        ------
        ConvergenceError
            If the chain is shorter than 50 autocorrelation times. `chain` is there all the same.
        """
        self._check_length()
        kept = self.chain[self.burn_in :: self.thinning]
        return self.model.to_samples(kept.reshape(-1, kept.shape[-1]), np.random.default_rng([self.seed, 1]))

    def report(self) -> str:
        """The summary as text.

        Returns
        -------
        str
        """
        return text_of(self)

    def kept(self) -> Samples:
        """The samples without the chain: a `Samples`, which can be written and read back.

        Returns
        -------
        Samples
        """
        return Samples(self.samples, self.frame, tuple(map(str, self.notes)), self.model.priors.in_words(), self.seed)

    def write(self, path: PathName, meta: dict[str, Any] | None = None) -> None:
        """Write the samples as a table, a column each; `Posterior.read` reads them back bit for bit, as `Samples`.

        The chain itself is what a checkpoint keeps.

        Parameters
        ----------
        path : str or Path
            An ECSV or FITS file.
        meta : dict, optional
            Provenance, plain values.
        """
        self.kept().write(path, meta)

    @classmethod
    def read(cls, path: PathName) -> Samples:
        """Samples that `write` wrote, a `Samples`.

        Parameters
        ----------
        path : str or Path
            An ECSV or FITS file.

        Returns
        -------
        Samples
        """
        return Samples.read(path)

    def to_arviz(self) -> Any:
        """The samples as arviz' InferenceData (its DataTree from version 1 on), a chain for each walker.

        Returns
        -------
        object

        Raises
        ------
        ImportError
            If arviz is not installed.
        ConvergenceError
            If the chain is too short.
        """
        try:
            arviz = import_quietly("arviz")
        except ImportError:
            raise ImportError("arviz is not installed: pip install 'vsh-astrometry[arviz]'") from None
        self._check_length()
        kept = np.moveaxis(self.chain[self.burn_in :: self.thinning], 1, 0)
        rng = np.random.default_rng([self.seed, 1])
        named = self.model.to_samples(kept.reshape(-1, kept.shape[-1]), rng)
        groups = {"posterior": {name: values.reshape(kept.shape[:2]) for name, values in named.items()}}
        new = int(arviz.__version__.split(".")[0]) >= 1
        return arviz.from_dict(groups) if new else arviz.from_dict(**groups)

    def corner(self, names: Sequence[str] | None = None) -> Figure:
        """Corner plot of some of the quantities; the same as `plot`. A matplotlib figure.

        Parameters
        ----------
        names : sequence of str, optional
            Which quantities.

        Returns
        -------
        Figure
        """
        return self.plot(names)

    def trace(self) -> Figure:
        """Trace plot: each coordinate of the walkers against the steps. A matplotlib figure.

        Returns
        -------
        Figure
        """
        from fit.posterior._plot import plot_trace

        return plot_trace(self)

    def _slowest(self):
        return float(np.max(list(self.autocorrelation.values())))  # nan if any is

    def _check_length(self):
        steps, walkers, _ = self.chain.shape
        slowest = self._slowest()
        if steps >= ENOUGH * slowest:
            return
        known = np.isfinite(slowest)
        said = f"{steps / slowest:.1f} autocorrelation times" if known else "so few that some walkers never moved"
        wanted = int(np.ceil(1.2 * ENOUGH * slowest)) if known else 10 * steps
        raise ConvergenceError(
            f"{steps} steps are {said}; {ENOUGH} times are needed for a result. Ask for "
            f"n_samples={wanted * walkers} or more (a chain with a checkpoint goes on from where it is)"
        )


def read_samples(path: PathName) -> dict[str, FloatArray]:
    """Samples that `Posterior.write` wrote: a dict of name to (n,) array.

    Parameters
    ----------
    path : str or Path
        An ECSV or FITS file.

    Returns
    -------
    dict[str, array]
    """
    return Samples.read(path).samples
