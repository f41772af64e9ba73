"""Samples in a few numbers: our own, since libraries change what an interval is."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fit.posterior._priors import FITS_UNITS, HUBBLE_LIMITS, SHORT_NAMES, UNITS
from fit.posterior._sampling import autocorrelate_chains, compute_split_r_hat, make_inference_data
from fit.results.storage import Result, check_count, check_strings
from vsh.io import tables
from vsh.io.sections import Section
from vsh.sky.frames import check_frame
from vsh.tools.arguments import float_array
from vsh.tools.digits import format_three_digits
from vsh.tools.errors import ParameterError
from vsh.tools.types import AxesArray, FloatArray, OnAxes, Table
from vsh.vector import Vector


class Interval(NamedTuple):
    """Summary of the samples of a quantity; the intervals have equal tails."""

    median: float
    low68: float
    high68: float
    low95: float
    high95: float
    mean: float
    sigma: float


def compute_intervals(samples: Mapping[str, FloatArray]) -> dict[str, Interval]:
    """An Interval for each name."""
    levels = [50, 15.865525, 84.134475, 2.5, 97.5]  # the median, the Gaussian's 1 σ, and 95 %
    return {
        name: Interval._make([*np.percentile(x, levels).tolist(), float(np.mean(x)), float(np.std(x, ddof=1))])
        for name, x in samples.items()
    }


class SampleResult(Result):
    """Samples of velocity, H0 and acceleration."""

    samples: Any
    frame: str
    notes: tuple[str, ...]

    @property
    def n_walkers(self) -> int:
        """Number of chains that the samples come from, step by step and within a step walker by walker."""
        raise NotImplementedError

    def __len__(self) -> int:
        return len(next(iter(self.samples.values())))

    def __iter__(self) -> Iterator[str]:
        return iter(self.samples)

    def __contains__(self, name: object) -> bool:
        return name in self.samples

    def __getitem__(self, name: str) -> FloatArray:
        """The samples of a quantity, by its name."""
        if name not in self.samples:
            raise ParameterError(f"no quantity is called {name!r}: there are {', '.join(self.samples)}")
        return self.samples[name]

    def to_pandas(self) -> Any:
        """The samples as a pandas DataFrame, a column a quantity."""
        from pandas import DataFrame

        return DataFrame(self.samples)

    def _compute_effective_sizes(self):
        """Effective number of independent samples of each quantity, by name."""
        return {name: x.size / float(autocorrelate_chains(self._unravel(name))[0]) for name, x in self.samples.items()}

    def _compute_r_hats(self):
        """Split R̂ of each quantity, by name."""
        return {name: float(compute_split_r_hat(self._unravel(name))[0]) for name in self.samples}

    def _unravel(self, name):
        return np.asarray(self.samples[name]).reshape(-1, self.n_walkers)[:, :, None]

    def summary(self) -> dict[str, Interval]:
        """Median, mean, σ, and the 68 and 95 % credible intervals of every quantity: a dict of `Interval`."""
        return compute_intervals(self.samples)

    @property
    def hubble_limits(self) -> tuple[float, float] | None:
        """Limits of H0: one-sided 95 % limits of H0, lower and upper, where its error is too large for a ±; else None.

        Where the samples reach the end of a flat prior that has no limit the upper one is inf: their scatter, however
        small, is that of where the sampler ends. [km/s/Mpc]
        """
        samples = self.samples["H0"]
        lower, median, upper = np.percentile(samples, [5, 50, 95]).tolist()
        is_at_end = np.mean(samples > _NEAR_END * HUBBLE_LIMITS[1]) > _AT_END and samples.max() <= HUBBLE_LIMITS[1]
        if is_at_end and not np.isfinite(self._largest_hubble):
            return lower, float("inf")
        return None if np.std(samples) < _WIDE_SHARE * median else (lower, upper)

    @property
    def _largest_hubble(self):
        """The upper limit of the prior on H0; nan where samples alone are left."""
        return float("nan")

    @property
    def product(self) -> tuple[float, float, float]:
        """v H0, which the motions determine: its median, and the ends of its 68 % interval. [(km/s)²/Mpc]"""
        products = self.samples["speed"] * self.samples["H0"]
        median, lower, upper = np.percentile(products, [50, 15.865525, 84.134475]).tolist()
        return median, lower, upper

    def print_summary(self) -> dict[str, list[str]]:
        """Median, and the limits of the 68 and 95 % intervals, to the digits that their Monte Carlo errors allow."""
        effective_sizes = self._compute_effective_sizes()
        return {name: _format_interval(interval, effective_sizes[name]) for name, interval in self.summary().items()}

    @property
    def velocity(self) -> Vector:
        """Mean and covariance of the velocity, a Vector in km/s, toward the apex."""
        return self._average_vector("v", "km/s")

    @property
    def acceleration(self) -> Vector:
        """Mean and covariance of the acceleration, a Vector in µas/yr."""
        return self._average_vector("a", "µas/yr")

    def to_table(self) -> Table:
        """The summary as an astropy Table, a row a quantity."""
        intervals = self.summary()
        columns = {"quantity": list(intervals), "unit": [UNITS.get(name, "") for name in intervals]}
        columns |= {key: [getattr(interval, key) for interval in intervals.values()] for key in Interval._fields}
        return tables.table_of(columns, {"frame": self.frame})

    def plot(
        self, names: Sequence[str] | None = None, truths: Mapping[str, float] | None = None, *, ax: OnAxes | None = None
    ) -> AxesArray:
        """Corner plot of some of the quantities: velocity, H0 and what else was free. On matplotlib axes."""
        from fit.posterior._plot import plot_corner

        return plot_corner(self, names, truths=truths, ax=ax)

    def _average_vector(self, name, unit):
        components = np.stack([self.samples[f"{name}_{axis}"] for axis in "xyz"])
        return Vector(components.mean(1), np.cov(components), self.frame, unit)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Samples(SampleResult):
    """Samples of a posterior without the chain they come from: what a file keeps.

    Attributes
    ----------
    samples : dict of str to (n,) array
        By name of quantity, as `Posterior.samples`.
    frame : str
        Axes of velocity and acceleration.
    notes : tuple of str
        What the reader should know of the data.
    priors : dict of str to str
        In words.
    seed : int
        Seed of the chain.
    walkers : int
        How many chains they come from: samples are in the order of steps, within a step in that of walkers.
    """

    samples: dict
    frame: str
    notes: tuple[str, ...]
    priors: dict
    seed: int
    walkers: int = 1

    @property
    def n_walkers(self) -> int:
        """Number of chains that the samples come from."""
        return self.walkers

    def to_arviz(self) -> Any:
        """The samples as arviz' InferenceData, a chain for each walker, without log-probabilities.

        Raises
        ------
        ImportError
            If arviz is not installed.
        """
        chains = {name: self._unravel(name)[:, :, 0].T for name in self.samples}
        return make_inference_data(chains, None, self.frame, UNITS)

    def __repr__(self) -> str:
        return f"<Samples: {len(self.samples['H0'])} of {', '.join(self.samples)}, {self.frame}>"

    def _sections(self, long):
        return (replace(make_summary(self, list_prior_facts(self.priors)), notes=self.notes),)

    def _pack(self):
        units = {name: FITS_UNITS[UNITS[name]] for name in self.samples if UNITS.get(name)}
        metadata = {"frame": self.frame, "notes": list(map(str, self.notes)), "priors": self.priors, "seed": self.seed}
        metadata["walkers"] = self.walkers
        return self.samples, metadata, units

    @classmethod
    def _unpack(cls, columns, metadata):
        samples = {name: float_array(name, values) for name, values in columns.items()}
        return cls(
            samples=samples,
            frame=check_frame(metadata["frame"]),
            notes=check_strings(metadata["notes"]),
            priors=dict(metadata["priors"]),
            seed=int(metadata["seed"]),
            walkers=_read_walker_count(samples, metadata),
        )


def _read_walker_count(samples, metadata):
    """The number of walkers of a file; one where an older file does not say it."""
    walkers = check_count(metadata.get("walkers", 1))
    if not walkers or any(values.size % walkers for values in samples.values()):
        raise ParameterError(f"{walkers} walkers do not go with the number of samples")
    return walkers


def make_posterior_sections(posterior: Any, long: bool = True) -> tuple[Section, ...]:
    """Make the sections of a posterior."""
    facts = list_prior_facts(posterior.model.priors.describe_in_words()) + _list_origin_facts(posterior) if long else []
    remarks = [*_list_limit_warnings(posterior), *_make_hubble_limit_remarks(posterior)]
    section = make_summary(posterior, facts, _find_fixed_velocity_names(posterior.model.priors))
    return (replace(section, remarks=remarks, notes=posterior.notes),)


def _list_origin_facts(posterior):
    """List facts on the origin of the samples."""
    steps, walkers, _ = posterior.chain.shape
    n_kept = len(posterior.samples["H0"])
    if posterior.method == "grid":
        return [("samples", f"{n_kept}, independent draws from a grid")]
    lengths = f"{steps / max(posterior.autocorrelation.values()):.0f} autocorrelation times"
    facts = [("chain", f"{steps} steps of {walkers} walkers = {lengths}; {n_kept} samples after burn-in and thinning")]
    if posterior.cells is None:
        return facts
    mean, sigma = posterior.cells.hubble
    error = sigma / np.sqrt(posterior.effective_size["H0"])
    pull = (np.mean(posterior.samples["H0"]) - mean) / error
    comparison = f"mean H0 is {pull:+.1f} of its Monte Carlo errors from that on a grid, {mean:.4g} ± {sigma:.2g}"
    return [*facts, ("check", comparison)]


def list_prior_facts(priors: Mapping[str, str]) -> list[tuple[str, str]]:
    """The priors, as labels with words."""
    dispersion = priors["peculiar_dispersion"]
    is_fixed = dispersion.replace(".", "").isdigit()
    remark = "fixed: in the weights alone" if is_fixed else "free: the scatter bears on its product with H0"
    flow = priors.get("flow_amplitude", "1")
    facts = [
        ("prior: velocity", priors["velocity"]),
        ("prior: H0", f"{priors['hubble']} km/s/Mpc"),
        ("prior: peculiar velocities", f"dispersion {dispersion} km/s ({remark})"),
        ("prior: flows", priors.get("flows", "none that galaxies share")),
        ("prior: excess noise", f"{priors['excess_noise']} µas/yr"),
    ]
    return facts + ([] if flow == "1" else [("prior: amplitude of the flow", f"{flow} (the flow bears on H0)")])


#: A prior on a velocity is sharp where its error is so many times smaller than it.
_SHARP = 30.0


def _find_fixed_velocity_names(priors):
    """Find the names of the velocity where its prior is sharp: the posterior gives it back."""
    prior = priors.velocity
    is_sharp = prior.gaussian and np.all(np.linalg.eigvalsh(prior.precision) * (prior.mean @ prior.mean) > _SHARP**2)
    return ["v_x", "v_y", "v_z", "speed"] if is_sharp else []


def make_summary(result: SampleResult, facts: Sequence[tuple[str, str]] = (), fixed: Sequence[str] = ()) -> Section:
    """Medians and intervals of a SampleResult; those that were given are marked as priors."""
    effective_sizes, r_hat = result._compute_effective_sizes(), result._compute_r_hats()
    quality = f"{min(effective_sizes.values()):.0f} independent samples at least, R̂ {max(r_hat.values()):.3f} at most"
    rows = []
    for name, (median, low68, high68, low95, high95) in result.print_summary().items():
        quantity = SHORT_NAMES.get(name, name) + (" (prior)" if name in fixed else "")
        rows.append((quantity, median, f"{low68} … {high68}", f"{low95} … {high95}", UNITS[name]))
    table = tables.table_of_rows(("quantity", "median", "68 %", "95 %", "unit"), rows)
    title = f"Posterior ({result.frame} axes, velocity toward the apex)"
    return Section(title, [*facts, ("effective", f"{quality}; digits are those they have")], table)


def _format_interval(interval, effective_size):
    """Median and limits to the digits that the Monte Carlo error of the median allows."""
    error = np.sqrt(np.pi / 2) * interval.sigma / np.sqrt(max(effective_size, 1.0))
    digits = int(np.clip(np.floor(-np.log10(error)), -6, 12)) if np.isfinite(error) and error > 0 else 4
    return [f"{round(value, digits):.{max(digits, 0)}f}" for value in interval[:5]]


#: Samples that reach so far towards the end of an infinite prior, and their share, say that H0 has no upper limit.
_NEAR_END, _AT_END = 0.9, 0.01
#: H0 is given by limits where its standard deviation is more than this share of its median.
_WIDE_SHARE = 1 / 3


def _make_hubble_limit_remarks(posterior):
    """v · H0, and one-sided limits of H0, where its error is too large for a ±."""
    if posterior.hubble_limits is None:
        return []
    lower, upper = posterior.hubble_limits
    product = posterior.product
    upper_words = f"below {format_three_digits(upper)} with 95 %" if np.isfinite(upper) else "not limited from above"
    return [
        f"v · H0: median {product[0]:.0f}, 68 % {product[1]:.0f} … {product[2]:.0f} (km/s)²/Mpc",
        f"H0 is {upper_words}, above {format_three_digits(lower)} with 95 % (one-sided) km/s/Mpc",
    ]


def _list_limit_warnings(posterior, margin=0.02, share=1e-3):
    """List warnings where samples lean against a limit that neither data nor priors give."""
    prior, samples = posterior.model.priors.hubble, posterior.samples["H0"]
    lower, upper = posterior.model.priors.limits("H0")
    warnings = []
    width = margin * (upper - lower)
    for limit, is_leaning, prior_limit in (
        (lower, samples < min(lower + width, lower * (1 + 5 * margin)), prior.low),
        (upper, samples > upper * (1 - margin), prior.high),
    ):
        if np.mean(is_leaning) > share:
            origin = "of the prior" if limit == prior_limit else "of the sampler"
            warnings.append(
                f"warning: {100 * np.mean(is_leaning):.2g} % of the samples lie next to H0 = {limit:g}, a limit "
                f"{origin}: the result depends on where it is"
            )
    return warnings
