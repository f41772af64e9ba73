"""A chain and what it says of our velocity and the Hubble constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import logsumexp

from fit.posterior._cells import Cells
from fit.posterior._model import MixtureModel, ParallaxModel
from fit.posterior._priors import HUBBLE_LIMITS, UNITS
from fit.posterior._summary import SampleResult, Samples, text_of
from fit.sampling import ENOUGH, Flat, Normal, autocorrelation, inference_data, split_r_hat
from vsh.io.tables import three_digits
from vsh.tools.errors import ConvergenceError
from vsh.tools.types import AxesArray, FloatArray, OnAxes, PathName

#: Levels of the columns: median, 68 %, and one-sided limits of 95 %.
_LEVELS = np.array([0.5, 0.15865525, 0.84134475, 0.95, 0.05])


class HubbleQuantiles(NamedTuple):
    """Quantiles of H0 under a prior. [km/s/Mpc]

    Attributes
    ----------
    median, low68, high68 : float
    below, above : float
        One-sided limits of 95 %.
    at_limits : bool
        Whether a fiftieth of the probability lies at the limits between which it was looked for.
    """

    median: float
    low68: float
    high68: float
    below: float
    above: float
    at_limits: bool = False


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
        Axes of velocity and acceleration.
    notes : tuple of str
    seed : int
    method : {"emcee", "grid"}
        Whether it is a chain, or independent draws in its form.
    cells : Cells or None
        The same posterior on a grid, where it is known there.
    """

    chain: FloatArray
    log_probability: FloatArray
    model: ParallaxModel | MixtureModel
    frame: str
    notes: tuple[str, ...]
    seed: int
    method: Literal["emcee", "grid"] = "emcee"
    cells: Cells | None = None

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
        """Steps left out at the start: five autocorrelation times of the slowest coordinate; none of draws."""
        begins_anywhere = self.method == "emcee" and self.cells is None
        return int(np.ceil(5 * self._slowest())) if begins_anywhere else 0

    @property
    def n_walkers(self) -> int:
        """How many walkers there are."""
        return self.chain.shape[1]

    @cached_property
    def r_hat(self) -> dict[str, float]:
        """Split R̂ of each coordinate after the burn-in, by name: 1 where all halves of walkers tell the same."""
        return dict(zip(self.model.names, map(float, split_r_hat(self._after_burn_in()))))

    @property
    def effective_size(self) -> dict[str, float]:
        """How many independent samples each coordinate's are worth after the burn-in, by name."""
        steps, walkers, _ = self._after_burn_in().shape
        return {name: steps * walkers / time for name, time in self.autocorrelation.items()}

    @property
    def thinning(self) -> int:
        """The thinning interval, in steps: half the autocorrelation time of the quickest."""
        return max(1, int(min(self.autocorrelation.values()) / 2))

    @cached_property
    def samples(self) -> dict[str, FloatArray]:
        """Samples after burn-in and thinning, by name: arrays (n,).

        v_x, v_y, v_z and speed [km/s, toward the apex, along the axes of `frame`]; H0 [km/s/Mpc]; a_x, a_y, a_z
        [µas/yr]; and what else was free: peculiar_dispersion [km/s], excess_noise [µas/yr], outlier_fraction.

        Raises
        ------
        ConvergenceError
            If the chain is shorter than 50 autocorrelation times. `chain` is there all the same.
        """
        self._check_length()
        kept = self.chain[self.burn_in :: self.thinning]
        return self.model.to_samples(kept.reshape(-1, kept.shape[-1]), np.random.default_rng([self.seed, 1]))

    def report(self, *, long: bool = False) -> str:
        """The summary as text.

        Parameters
        ----------
        long : bool
            Add the priors, the chain, and H0 under other priors.
        """
        return "\n".join([text_of(self, long), *(_sensitivity_lines(self.hubble_by_prior) if long else [])])

    @cached_property
    def hubble_by_prior(self) -> dict[str, HubbleQuantiles]:
        """Quantiles of H0 under several priors, by their names; empty where the likelihood has no closed form."""
        return _hubble_by_prior(self.model)

    def kept(self) -> Samples:
        """The samples without the chain: a `Samples`, which can be written and read back."""
        return Samples(
            self.samples,
            self.frame,
            tuple(map(str, self.notes)),
            self.model.priors.in_words(),
            self.seed,
            self.n_walkers,
        )

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
    def read(cls, path: PathName) -> Samples:  # type: ignore[override]  # the likelihood is not written
        """Samples that `write` wrote to an ECSV or FITS file `path`, a `Samples`."""
        return Samples.read(path)

    def to_arviz(self) -> Any:
        """The samples as arviz' InferenceData (its DataTree from version 1 on), a chain for each walker.

        Every quantity of `samples` by its name; and `velocity` and `acceleration` with the coordinate `axis` (x, y, z).
        Units and the frame are attributes; `sample_stats` has the log-probability.

        Raises
        ------
        ImportError
            If arviz is not installed.
        ConvergenceError
            If the chain is too short.
        """
        self._check_length()
        every = slice(self.burn_in, None, self.thinning)
        kept = np.moveaxis(self.chain[every], 1, 0)
        named = self.model.to_samples(kept.reshape(-1, kept.shape[-1]), np.random.default_rng([self.seed, 1]))
        chains = {name: values.reshape(kept.shape[:2]) for name, values in named.items()}
        return inference_data(chains, self.log_probability[every].T, self.frame, UNITS)

    def corner(
        self, names: Sequence[str] | None = None, truths: Mapping[str, float] | None = None, *, ax: OnAxes | None = None
    ) -> AxesArray:
        """Corner plot of some of the quantities; the same as `plot`. On matplotlib axes.

        Parameters
        ----------
        names : sequence of str, optional
            Which quantities.
        truths : dict of str to float, optional
            True values by name, drawn as lines.
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        return self.plot(names, truths, ax=ax)

    def trace(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Trace plot: each coordinate of the walkers against the steps. On matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.posterior._plot import plot_trace

        return plot_trace(self, ax=ax)

    def _after_burn_in(self):
        """The chain as it is kept; its second half where it is too short to tell."""
        slowest = self._slowest()
        half = len(self.chain) // 2
        return self.chain[min(half, self.burn_in) if np.isfinite(slowest) else half :]

    def _slowest(self):
        return float(np.max(list(self.autocorrelation.values())))  # nan if any is

    def _check_length(self):
        steps, walkers, _ = self.chain.shape
        slowest = self._slowest()
        if steps >= ENOUGH * slowest:
            return
        known = np.isfinite(slowest)
        length = f"{steps / slowest:.1f} autocorrelation times" if known else "so few that some walkers never moved"
        wanted = int(np.ceil(2.5 * ENOUGH * slowest)) if known else 10 * steps
        raise ConvergenceError(
            f"{steps} steps are {length}; {ENOUGH} times are needed for a result. Ask for n_samples={wanted * walkers} "
            "or more, or max_samples= (a chain with a checkpoint goes on from where it is)"
        )


def read_samples(path: PathName) -> dict[str, FloatArray]:
    """Samples that `Posterior.write` wrote: a dict of name to (n,) array.

    Parameters
    ----------
    path : str or Path
        An ECSV or FITS file.
    """
    return Samples.read(path).samples


#: How many values of H0, and of each other number that is free, by how many there are.
_POINTS = {0: (4000, 1), 1: (800, 150), 2: (300, 40)}


def _hubble_likelihood(model: Any) -> tuple[FloatArray, FloatArray] | None:
    """H0, and ln of its likelihood with all else integrated over its prior; None where there is no closed form."""
    if not hasattr(model, "conditional") or not model.priors.velocity.gaussian:
        return None
    others = {name: prior for name, prior in model.priors.free.items() if name != "H0"}
    if len(others) > max(_POINTS):
        return None
    number, each = _POINTS[len(others)]
    hubble, log_prior, axes = np.geomspace(*HUBBLE_LIMITS, number), np.zeros(()), []
    for name, prior in others.items():
        low, high = model.priors.limits(name)
        axes.append(np.geomspace(max(low, 1e-3 * high), high, each))  # what is large goes with an H0 that is small
        log_prior = np.add.outer(log_prior, prior.log(axes[-1]) + np.log(np.gradient(axes[-1])))
    total = np.empty(number)
    for part in np.array_split(np.arange(number), max(1, number * log_prior.size // 20_000)):
        points = np.stack([grid.ravel() for grid in np.meshgrid(hubble[part], *axes, indexing="ij")], axis=1)
        log = model.conditional(points, with_priors=False)[0].reshape(len(part), -1)
        total[part] = logsumexp(log + log_prior.ravel(), axis=1)
    fine = np.geomspace(*HUBBLE_LIMITS, 4000)
    return fine, np.interp(np.log(fine), np.log(hubble), total)


def _other_priors(prior: Any) -> dict[str, Any]:
    """Priors beside the one that was given, as functions of H0 that return log-densities."""
    priors = {"as given": prior.log}
    if isinstance(prior, Normal):
        priors["twice as wide"] = Normal(prior.mean, 2 * prior.sigma, prior.low, prior.high).log
    if isinstance(prior, Flat) and prior.proper:
        width = prior.high - prior.low
        priors["twice as wide"] = Flat(max(prior.low - width / 2, 0.0), prior.high + width / 2).log
    return priors | {
        "flat in H0": np.zeros_like,
        "flat in v H0": lambda h: 3 * np.log(h),
        "flat in log H0": lambda h: -np.log(h),
    }


def _hubble_by_prior(model):
    """Quantiles of H0 under several priors, by their names."""
    known = _hubble_likelihood(model)
    if known is None or not np.isfinite(known[1]).any():
        return {}
    hubble, log = known
    step, quantiles = np.gradient(hubble), {}
    for name, prior in _other_priors(model.priors.hubble).items():
        total = log + prior(hubble)
        weight = np.where(np.isfinite(total), np.exp(total - np.nanmax(total[np.isfinite(total)])), 0.0) * step
        share = np.cumsum(weight) / weight.sum()
        ends = weight[:40].sum() + weight[-40:].sum()  # within a factor of 1.07 of a limit
        leans = bool(ends > 0.02 * weight.sum())
        median, low, high, below, above = np.interp(_LEVELS, share, hubble).tolist()
        quantiles[name] = HubbleQuantiles(median, low, high, below, above, leans)
    return quantiles


def _sensitivity_lines(quantiles: dict[str, HubbleQuantiles]) -> list[str]:
    """A table of H0 under several priors, as lines; none where there are no quantiles."""
    if not quantiles:
        return []
    lines = ["H0 under other priors [km/s/Mpc], between 1 and 1000; one-sided limits"]
    lines.append(f"{'':18}{'median':>10}{'68 %':>22}{'95 % below':>14}{'95 % above':>12}")
    for name, each in quantiles.items():
        remark = "  (leans on the limits)" if each.at_limits else ""
        cells = [three_digits(value) for value in each[:5]]
        lines.append(f"{name:18}{cells[0]:>10}{cells[1]:>11} …{cells[2]:>9}{cells[3]:>14}{cells[4]:>12}{remark}")
    return lines
