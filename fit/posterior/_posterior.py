"""The posterior of our velocity and the Hubble constant, by its samples.

Given H0 and what else is free the velocity is Gaussian, so that a cell of one or two numbers is all there is to draw:
`Cells` has the draws, and the moves of a chain by them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import logsumexp

from fit.posterior._model import ParallaxModel
from fit.posterior._priors import HUBBLE_LIMITS, UNITS, ModelPriors
from fit.posterior._sampling import ENOUGH, Flat, Normal, autocorrelate_chains, compute_split_r_hat, make_inference_data
from fit.posterior._summary import SampleResult, Samples, make_posterior_sections
from vsh.io import tables
from vsh.io.sections import Section
from vsh.tools.digits import format_three_digits
from vsh.tools.errors import ConvergenceError, ParameterError
from vsh.tools.types import AxesArray, FloatArray, OnAxes, PathName

#: How many numbers cells are made of at most; cells along each for one and for two, to see where it is and in the end.
MAX_FREE_NUMBERS = 2
_CELL_COUNTS = {1: (400, 4000), 2: (100, 200)}


@dataclass(frozen=True, eq=False)
class Cells:
    """The posterior of the free numbers, the velocity integrated, constant within each cell.

    Attributes
    ----------
    model : ParallaxModel
        With a velocity whose prior is Gaussian or flat, and two free numbers at most.
    edges : tuple of arrays
        Edges of the cells along each number.
    probability : array
        Probability of each cell; sums to 1.
    mean, covariance : (n, 3) and (n, 3, 3) arrays
        Moments of the velocity in the middle of each cell, the last number running fastest. [km/s]
    """

    model: ParallaxModel
    edges: tuple[FloatArray, ...]
    probability: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, model: ParallaxModel, count: int | None = None) -> Cells:
        """Cells of a model: `count` of equal size along each number, or closer where the density is high."""
        limits = [model.priors.limits(name) for name in model.priors.free]
        coarse_count, fine_count = _CELL_COUNTS[len(limits)]
        edges = [np.linspace(*pair, (count or coarse_count) + 1) for pair in limits]
        for _ in range(2):  # what the one before left over
            coarse_cells = cls._evaluate_on_grid(model, edges)
            limits = [_find_support(edge, share) for edge, share in zip(edges, coarse_cells.shares, strict=True)]
            edges = [np.linspace(*pair, (count or coarse_count) + 1) for pair in limits]
        cells = cls._evaluate_on_grid(model, edges)
        if count is not None:
            return cells
        return cls._evaluate_on_grid(
            model, [_refine_edges(edge, share, fine_count) for edge, share in zip(edges, cells.shares, strict=True)]
        )

    @classmethod
    def _evaluate_on_grid(cls, model, edges):
        middles = [(edge[1:] + edge[:-1]) / 2 for edge in edges]
        points = np.stack([grid.ravel() for grid in np.meshgrid(*middles, indexing="ij")], axis=1)
        log_density, mean, covariance = model.marginalise_velocity(points)
        volume = reduce(np.multiply.outer, [np.diff(edge) for edge in edges])
        probability = np.exp(log_density - log_density.max()).reshape(volume.shape) * volume
        return cls(model, tuple(edges), probability / probability.sum(), mean, covariance)

    @property
    def shares(self) -> list[FloatArray]:
        """The probabilities along each number, the other summed."""
        axes = range(self.probability.ndim)
        return [self.probability.sum(tuple(i for i in axes if i != axis)) for axis in axes]

    @property
    def axes(self) -> tuple[FloatArray, ...]:
        """The middles of the cells along each number."""
        return tuple((edge[1:] + edge[:-1]) / 2 for edge in self.edges)

    @property
    def hubble(self) -> tuple[float, float]:
        """Mean and standard deviation of H0. [km/s/Mpc]"""
        share, hubble = self.shares[0], self.axes[0]
        mean = float(share @ hubble)
        return mean, float(np.sqrt(share @ (hubble - mean) ** 2))

    def draw(self, rng: np.random.Generator | np.random.RandomState, n: int) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the model, (n, d), and the log-density they were drawn with, up to a constant."""
        cumulative = np.cumsum(self.probability.ravel())
        flat_index = np.searchsorted(cumulative, rng.uniform(size=n) * cumulative[-1], side="right")
        cell_indices = np.unravel_index(np.minimum(flat_index, cumulative.size - 1), self.probability.shape)
        lower = np.stack([edge[i] for edge, i in zip(self.edges, cell_indices, strict=True)], axis=1)
        upper = np.stack([edge[i + 1] for edge, i in zip(self.edges, cell_indices, strict=True)], axis=1)
        numbers = lower + (upper - lower) * rng.uniform(size=lower.shape)
        velocity, log_velocity = self.model.draw_velocity_and_density(rng, numbers)
        return np.column_stack([velocity, numbers]), self._compute_log_cell_density(cell_indices) + log_velocity

    def log_density(self, theta: FloatArray) -> FloatArray:
        """The log-density with which `draw` gives coordinates (n, d), up to the same constant."""
        cell_indices, is_inside = [], np.ones(len(theta), bool)
        for edge, column in zip(self.edges, theta[:, 3:].T, strict=True):
            axis_cells = np.searchsorted(edge, column, side="right") - 1
            is_inside &= (axis_cells >= 0) & (axis_cells < edge.size - 1)
            cell_indices.append(np.clip(axis_cells, 0, edge.size - 2))
        log = np.where(is_inside, self._compute_log_cell_density(tuple(cell_indices)), -np.inf)
        return log + self.model.log_density_of_velocity(theta)

    def propose(self, coordinates: FloatArray, rng: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """A move of emcee: to an independent draw, and by how much it is harder to come back."""
        draws, log_new = self.draw(rng, len(coordinates))
        return draws, self.log_density(coordinates) - log_new

    def draw_independent(self, rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        """n independent draws of the posterior itself, (n, d), and their log-densities.

        Draws are kept with the ratio of the posterior to the density of the cells, over the largest that was seen: what
        varies within a cell is allowed for.
        """
        batches: list[tuple[FloatArray, FloatArray]] = []
        n_kept, log_bound = 0, -np.inf
        while n_kept < n:
            theta, log_drawn = self.draw(rng, n - n_kept + n // 16 + 100)
            log_probability = self.model.log_probability(theta)
            if not batches:
                log_bound = float(np.max(log_probability - log_drawn))
            is_kept = np.log(rng.uniform(size=len(theta))) < log_probability - log_drawn - log_bound
            batches.append((theta[is_kept], log_probability[is_kept]))
            n_kept += int(is_kept.sum())
        theta, log_probability = (np.concatenate(arrays)[:n] for arrays in zip(*batches, strict=True))
        return theta, log_probability

    def _compute_log_cell_density(self, cell_indices):
        """The log-density within some cells."""
        log_volume = sum(np.log(np.diff(edge))[i] for edge, i in zip(self.edges, cell_indices, strict=True))
        with np.errstate(divide="ignore"):
            return np.log(self.probability[cell_indices]) - log_volume


def check_grid_possible(priors: ModelPriors) -> None:
    """Raise ParameterError where a posterior is not known in cells."""
    names = tuple(priors.free)
    if len(names) > MAX_FREE_NUMBERS:
        raise ParameterError(f"a grid of {', '.join(names)} is too large: fix all but two, or sample with emcee")
    if not priors.velocity.gaussian:
        raise ParameterError("on a grid the prior on the velocity must be Gaussian or flat: sample with emcee")


def make_cells_if_possible(model: Any) -> Cells | None:
    """The cells of a model; None where it has none."""
    try:
        check_grid_possible(model.priors)
    except ParameterError:
        return None
    return Cells.of(model)


def _find_support(edges, shares):
    """Find the limits beyond which every share is less than 1e-9 of the largest."""
    populated_cells = np.flatnonzero(shares > 1e-9 * shares.max())
    return edges[populated_cells[0]], edges[populated_cells[-1] + 1]


def _refine_edges(edges, share, count):
    """Edges of cells of which half share the probability evenly, and half the range."""
    uniform = np.linspace(0, 1, edges.size)
    return np.interp(np.linspace(0, 1, count + 1), (np.concatenate([[0.0], np.cumsum(share)]) + uniform) / 2, edges)


#: Levels of the columns: median, 68 %, and one-sided limits of 95 %.
_QUANTILE_LEVELS = np.array([0.5, 0.15865525, 0.84134475, 0.95, 0.05])


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


#: Independent samples that 95 % intervals need: their limits then scatter by a tenth of the standard deviation.
_FEWEST_SAMPLES = 1000


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Posterior(SampleResult):
    """A chain and what it says.

    Attributes
    ----------
    chain : (steps, walkers, d) array
        All of it, in the coordinates of the sampler.
    log_probability : (steps, walkers) array
    model : ParallaxModel
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
    model: ParallaxModel
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
        """Integrated autocorrelation time of each coordinate, by name; 1 of independent draws. [steps]"""
        times = autocorrelate_chains(self.chain) if self.method == "emcee" else np.ones(len(self.model.names))
        return dict(zip(self.model.names, map(float, times)))

    @property
    def _largest_hubble(self):
        return self.model.priors.hubble.high

    @property
    def burn_in(self) -> int:
        """Steps left out at the start: five autocorrelation times of the slowest coordinate; none of draws."""
        has_burn_in = self.method == "emcee" and self.cells is None
        steps = 5 * np.nan_to_num(self._find_longest_autocorrelation_time(), nan=np.inf)  # of a walker that never moved
        return int(min(np.ceil(steps), len(self.chain))) if has_burn_in else 0

    @property
    def n_walkers(self) -> int:
        """Number of walkers."""
        return self.chain.shape[1]

    @cached_property
    def r_hat(self) -> dict[str, float]:
        """Split R̂ of each coordinate after the burn-in, by name: 1 where all halves of walkers tell the same."""
        return dict(zip(self.model.names, map(float, compute_split_r_hat(self._cut_burn_in()))))

    @property
    def effective_size(self) -> dict[str, float]:
        """Effective number of independent samples of each coordinate after the burn-in, by name."""
        steps, walkers, _ = self._cut_burn_in().shape
        return {name: steps * walkers / time for name, time in self.autocorrelation.items()}

    @property
    def thinning(self) -> int:
        """The thinning interval, in steps: half the autocorrelation time of the quickest."""
        return max(1, int(np.nan_to_num(min(self.autocorrelation.values())) / 2))

    @cached_property
    def samples(self) -> dict[str, FloatArray]:
        """Samples after burn-in and thinning, by name: arrays (n,).

        v_x, v_y, v_z and speed [km/s, toward the apex, along the axes of `frame`]; H0 [km/s/Mpc]; a_x, a_y, a_z
        [µas/yr]; and what else was free: peculiar_dispersion [km/s], excess_noise [µas/yr].

        Raises
        ------
        ConvergenceError
            If the chain is shorter than 50 autocorrelation times. `chain` is there all the same.
        """
        self._check_chain_length()
        draws = self.chain[self.burn_in :: self.thinning]
        return self.model.to_samples(draws.reshape(-1, draws.shape[-1]), np.random.default_rng([self.seed, 1]))

    def _sections(self, long):
        quantiles = self.hubble_by_prior if long else {}
        return (*make_posterior_sections(self, long), *([_make_hubble_prior_section(quantiles)] if quantiles else []))

    @cached_property
    def hubble_by_prior(self) -> dict[str, HubbleQuantiles]:
        """Quantiles of H0 under several priors, by their names; empty where the likelihood has no closed form."""
        return _compute_hubble_quantiles(self.model)

    def kept(self) -> Samples:
        """The samples without the chain: a `Samples`, which can be written and read back."""
        return Samples(
            samples=self.samples,
            frame=self.frame,
            notes=tuple(map(str, self.notes)),
            priors=self.model.priors.describe_in_words(),
            seed=self.seed,
            walkers=self.n_walkers,
        )

    def write(self, path: PathName, meta: dict[str, Any] | None = None, *, overwrite: bool = False) -> None:
        """Write the samples as a table, a column each; `Posterior.read` reads them back bit for bit, as `Samples`.

        The chain itself is what a checkpoint keeps.

        Parameters
        ----------
        path : str or Path
            An ECSV or FITS file.
        meta : dict, optional
            Provenance, plain values.
        overwrite : bool
            Whether a file that is there is replaced.
        """
        self.kept().write(path, meta, overwrite=overwrite)

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
        chains = {name: self._unravel(name)[:, :, 0].T for name in self.samples}
        log_probability = self.log_probability[self.burn_in :: self.thinning]
        return make_inference_data(chains, log_probability.T, self.frame, UNITS)

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

    def _cut_burn_in(self):
        """The chain as it is kept; its second half where it is too short to tell."""
        longest = self._find_longest_autocorrelation_time()
        half = len(self.chain) // 2
        return self.chain[min(half, self.burn_in) if np.isfinite(longest) else half :]

    def _find_longest_autocorrelation_time(self):
        return float(np.max(list(self.autocorrelation.values())))  # nan if any is

    def _check_chain_length(self):
        steps, walkers, _ = self.chain.shape
        if self.method == "grid":
            if steps * walkers < _FEWEST_SAMPLES:
                raise ConvergenceError(
                    f"{steps * walkers} samples are too few for 95 % intervals: ask for {_FEWEST_SAMPLES} or more "
                    "(n_samples=, --posterior N)"
                )
            return
        longest = self._find_longest_autocorrelation_time()
        if steps >= ENOUGH * longest:
            return
        is_finite = np.isfinite(longest)
        length = f"{steps / longest:.1f} autocorrelation times" if is_finite else "so few that some walkers never moved"
        target_steps = int(np.ceil(2.5 * ENOUGH * longest)) if is_finite else 10 * steps
        raise ConvergenceError(
            f"{steps} steps are {length}; {ENOUGH} times are needed for a result. Ask for "
            f"{target_steps * walkers} samples or more (n_samples=, --posterior; in Python also max_samples=); a chain "
            "with a checkpoint goes on from "
            "where it is"
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
_HUBBLE_GRID_SIZES = {0: (4000, 1), 1: (800, 150), 2: (300, 40)}


def _compute_hubble_log_likelihood(model: Any) -> tuple[FloatArray, FloatArray] | None:
    """H0, and ln of its likelihood with all else integrated over its prior; None where there is no closed form."""
    nuisance_priors = {name: prior for name, prior in model.priors.free.items() if name != "H0"}
    if not model.priors.velocity.gaussian or len(nuisance_priors) > max(_HUBBLE_GRID_SIZES):
        return None
    n_hubble, n_nuisance = _HUBBLE_GRID_SIZES[len(nuisance_priors)]
    # What depends on H0 beside v was tabulated for the H0 that its prior allows.
    is_tabulated = bool(nuisance_priors) or model.priors.group is not None
    limits = model.priors.limits("H0") if is_tabulated else HUBBLE_LIMITS
    hubble, log_prior, grids = (np.geomspace(max(limits[0], HUBBLE_LIMITS[0]), limits[1], n_hubble), np.zeros(()), [])
    for name, prior in nuisance_priors.items():
        lower, upper = model.priors.limits(name)
        # What is large goes with an H0 that is small.
        grids.append(np.geomspace(max(lower, 1e-3 * upper), upper, n_nuisance))
        log_prior = np.add.outer(log_prior, prior.log(grids[-1]) + np.log(np.gradient(grids[-1])))
    log_likelihood = np.empty(n_hubble)
    for chunk in np.array_split(np.arange(n_hubble), max(1, n_hubble * log_prior.size // 20_000)):
        points = np.stack([grid.ravel() for grid in np.meshgrid(hubble[chunk], *grids, indexing="ij")], axis=1)
        log_marginal = model.marginalise_velocity(points, with_priors=False)[0].reshape(len(chunk), -1)
        log_likelihood[chunk] = logsumexp(log_marginal + log_prior.ravel(), axis=1)
    fine_hubble = np.geomspace(hubble[0], hubble[-1], 4000)
    return fine_hubble, np.interp(np.log(fine_hubble), np.log(hubble), log_likelihood)


def _list_log_priors(prior: Any) -> dict[str, Any]:
    """List priors beside the one that was given, as functions of H0 that return log-densities."""
    priors = {"as given": prior.log}
    if isinstance(prior, Normal):
        priors["twice as wide"] = Normal(prior.mean, 2 * prior.sigma, prior.low, prior.high).log
    if isinstance(prior, Flat) and prior.proper:
        width = prior.high - prior.low
        priors["twice as wide"] = Flat(max(prior.low - width / 2, 0.0), prior.high + width / 2).log
    return priors | {
        "flat in H0": np.zeros_like,
        "flat in v H0": lambda hubble: 3 * np.log(hubble),
        "flat in log H0": lambda hubble: -np.log(hubble),
    }


def _compute_hubble_quantiles(model):
    """Compute quantiles of H0 under several priors, by their names."""
    likelihood = _compute_hubble_log_likelihood(model)
    if likelihood is None or not np.isfinite(likelihood[1]).any():
        return {}
    hubble, log_likelihood = likelihood
    widths, quantiles = np.gradient(hubble), {}
    for name, log_prior in _list_log_priors(model.priors.hubble).items():
        log_p = log_likelihood + log_prior(hubble)
        weight = np.where(np.isfinite(log_p), np.exp(log_p - np.nanmax(log_p[np.isfinite(log_p)])), 0.0) * widths
        cumulative = np.cumsum(weight) / weight.sum()
        end_weight = weight[:40].sum() + weight[-40:].sum()  # within a factor of 1.07 of a limit
        hubble_values = np.interp(_QUANTILE_LEVELS, cumulative, hubble).tolist()
        quantiles[name] = HubbleQuantiles._make([*hubble_values, bool(end_weight > 0.02 * weight.sum())])
    return quantiles


def _make_hubble_prior_section(quantiles: dict[str, HubbleQuantiles]) -> Section:
    """Make the section of H0 under several priors."""
    rows = []
    for name, hubble_quantiles in quantiles.items():
        median, low68, high68, below, above = map(format_three_digits, hubble_quantiles[:5])
        rows.append((name, median, f"{low68} … {high68}", below, above))
    table = tables.table_of_rows(("prior", "median", "68 %", "95 % below", "95 % above"), rows)
    names_at_limits = [name for name, hubble_quantiles in quantiles.items() if hubble_quantiles.at_limits]
    remarks = ["Computed on a grid: “as given” differs from the limits above by the Monte Carlo error of the samples."]
    remarks += [f"Leans on the limits: {', '.join(names_at_limits)}."] if names_at_limits else []
    title = "H0 under other priors [km/s/Mpc], between 1 and 1000; one-sided limits"
    return Section(title, (), table, remarks=remarks)
