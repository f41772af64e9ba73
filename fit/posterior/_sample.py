"""Posteriors of our velocity and the Hubble constant, by Markov chains (emcee) or on a grid."""

import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fit.posterior._mixture import MixtureModel
from fit.posterior._model import drift_model
from fit.posterior._priors import priors
from fit.posterior._summary import FITS_UNITS, UNITS, intervals, text_of
from fit.sampling import Run, as_prior, autocorrelation, check_writable, fingerprint
from fit.secular_parallax import drift_rows
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.frozen import Frozen
from vsh.errors import ConvergenceError, ParameterError
from vsh.field import Field
from vsh.system.quiet import import_quietly
from vsh.vector import Vector

#: A chain shorter than this many autocorrelation times says nothing certain, not even about its length.
ENOUGH = 50


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Frozen):
    """A chain and what it says.

    Attributes
    ----------
    chain : (steps, walkers, d) array
        All of it, in the coordinates of the sampler.
    log_probability : (steps, walkers) array
    model : DriftModel or MixtureModel
    frame : str
        Of velocity and acceleration.
    notes : tuple of str
    seed : int
    """

    chain: np.ndarray
    log_probability: np.ndarray
    model: object
    frame: str
    notes: tuple
    seed: int

    def __repr__(self):
        steps, walkers, _ = self.chain.shape
        return f"<Posterior: {steps} steps of {walkers} walkers, {', '.join(self.model.names)}, {self.frame}>"

    @cached_property
    def autocorrelation(self):
        """Integrated autocorrelation time of each coordinate, by name. [steps]"""
        times = autocorrelation(self.chain)
        return dict(zip(self.model.names, map(float, times)))

    @property
    def burn_in(self):
        """Steps left out at the start: five autocorrelation times of the slowest coordinate."""
        return int(np.ceil(5 * self._slowest()))

    @property
    def thin(self):
        """Every how many steps one is kept: half the autocorrelation time of the quickest."""
        return max(1, int(min(self.autocorrelation.values()) / 2))

    @cached_property
    def samples(self):
        """Samples after burn-in and thinning, by name: arrays (n,).

        v_x, v_y, v_z and speed [km/s, toward the apex, along the axes of `frame`]; H0
        [km/s/Mpc]; a_x, a_y, a_z [µas/yr]; and what else was free: sigma_pec [km/s],
        sigma_extra [µas/yr], outlier_fraction.

        Raises
        ------
        ConvergenceError
            If the chain is shorter than 50 autocorrelation times. `chain` is there all the same.
        """
        self._check_length()
        kept = self.chain[self.burn_in :: self.thin]
        return self.model.to_samples(kept.reshape(-1, kept.shape[-1]), np.random.default_rng([self.seed, 1]))

    def summary(self):
        """Median, mean, σ, and the 68 and 95 % credible intervals of every quantity: a dict of `Interval`."""
        return intervals(self.samples)

    @property
    def velocity(self):
        """Mean and covariance of the velocity, a Vector in km/s, toward the apex."""
        return self._vector("v", "km/s")

    @property
    def acceleration(self):
        """Mean and covariance of the acceleration, a Vector in µas/yr."""
        return self._vector("a", "µas/yr")

    def report(self):
        """The summary as text."""
        return text_of(self)

    def write(self, path, meta=None):
        """Write the samples as a table, a column each, which `read_samples` or astropy reads back bit for bit.

        The chain itself is what a checkpoint keeps.
        """
        from vsh import tables

        about = {"type": "Posterior", "seed": self.seed, "notes": list(map(str, self.notes))}
        about = {"frame": self.frame, "RESULT": json.dumps(about | {"priors": self.model.priors.describe()})}
        tables.write(
            path,
            self.samples,
            about | (meta or {}),
            {name: FITS_UNITS[UNITS[name]] for name in self.samples if UNITS.get(name)},
        )

    def to_arviz(self):
        """The samples as arviz' InferenceData (its DataTree from version 1 on), a chain for each walker."""
        try:
            arviz = import_quietly("arviz")
        except ImportError:
            raise ImportError("arviz is not installed: pip install 'vsh-astrometry[arviz]'") from None
        self._check_length()
        kept = np.moveaxis(self.chain[self.burn_in :: self.thin], 1, 0)
        rng = np.random.default_rng([self.seed, 1])
        named = self.model.to_samples(kept.reshape(-1, kept.shape[-1]), rng)
        groups = {"posterior": {name: values.reshape(kept.shape[:2]) for name, values in named.items()}}
        new = int(arviz.__version__.split(".")[0]) >= 1
        return arviz.from_dict(groups) if new else arviz.from_dict(**groups)

    def corner(self, names=None):
        """Corner plot of some of the quantities: velocity, H0 and what else was free. A matplotlib figure."""
        from fit.posterior._plot import plot_corner

        return plot_corner(self, names)

    def trace(self):
        """The walkers' way, coordinate by coordinate. A matplotlib figure."""
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

    def _vector(self, name, unit):
        three = np.stack([self.samples[f"{name}_{axis}"] for axis in "xyz"])
        return Vector(three.mean(1), np.cov(three), self.frame, unit)


def read_samples(path):
    """Samples that `Posterior.write` wrote: a dict of name to (n,) array."""
    from vsh import tables

    table = tables.read(path)
    return {name: np.asarray(table[name], float) for name in table.colnames}


@arguments.accepts(field=arguments.a(Field), n_samples=arguments.whole, rng=arguments.seed, walkers=arguments.whole)
def sample(
    field,
    velocity_prior="planck",
    hubble_prior="flat",
    n_samples=400_000,
    rng=1,
    checkpoint=None,
    cosmology=None,
    peculiar=750.0,
    extra=0.0,
    outliers=None,
    outlier_width=None,
    spin=None,
    walkers=None,
    progress=True,
    threads=None,
    save_every=5.0,
):
    """Sample the posterior of our velocity and the Hubble constant, the acceleration marginalised.

    Parameters
    ----------
    field : Field
        With redshifts, none below the flow.
    velocity_prior : "planck", "flat", "flat-product", Vector with covariance [km/s], or a function
        "flat" is flat in v: p(H0) then goes as its prior over H0³, and a prior on H0 for which that has no
        integral is refused. "flat-product" is flat in u = v H0, which is what the data see: the prior on H0
        comes back. A function takes velocities (n, 3) along the field's axes and returns log-densities (n,).
    hubble_prior : "planck", "flat", (mean, σ), Flat, Normal or Density
        [km/s/Mpc] "flat" has no upper limit; the chain stays below 1000.
    n_samples : int
        Steps times walkers, before burn-in and thinning.
    rng : Generator or int
    checkpoint : path, optional
        The chain is kept in this file (NumPy's npz, no pickles), and a run that was broken off goes
        on from it. The result is the same, bit for bit, as without the break.
    cosmology : astropy cosmology, optional
        The shape of the distance.
    peculiar : float or prior
        Dispersion of peculiar velocities in each component. [km/s] Fixed, it enters the weights
        alone, for the cosmology's H0; with a prior, the scatter of the galaxies bears on σ_pec H0
        and so, as far as σ_pec is known, on H0.
    extra : float or prior
        Noise beyond the catalogue's in each component, fixed or free. [µas/yr]
    outliers : prior, optional
        Of the fraction of sources not to be trusted. Every sample then looks at every source.
    outlier_width : float, optional
        Their noise beyond the catalogue's; ten times the median error unless given. [µas/yr]
    spin : None, "free" or Vector
        No spin; a flat prior; or a Gaussian one. [µas/yr]
    walkers : int, optional
    progress : bool
        Show a bar, after two seconds.
    save_every : float — between checkpoints, at least [s]

    Returns
    -------
    Posterior

    Raises
    ------
    ParameterError
        If a prior is none, neither of the two is proper, or the posterior has no integral.
    CheckpointError
        If the checkpoint belongs to another run, or is damaged.
    DegeneracyError, FieldError
        As for `fit.drift.observer_velocity`.

    Notes
    -----
    emcee (Foreman-Mackey et al. 2013, PASP 125, 306) with moves by differential evolution, one in
    ten of them from mode to mode (ter Braak 2006).
    """
    given = priors(velocity_prior, hubble_prior, peculiar, extra, field.frame)
    rows = drift_rows(field, cosmology)
    model = drift_model(rows, given, spin, threads)
    if outliers is not None:
        width = 10 * float(np.median(np.sqrt(rows.variance))) if outlier_width is None else float(outlier_width)
        model = MixtureModel(model, rows, as_prior(outliers, "outliers"), width, spin, threads)
    walkers = walkers or (128 if outliers is None else 64)
    if walkers < 2 * len(model.names):
        raise ParameterError(f"{walkers} walkers are too few for {len(model.names)} coordinates: take twice as many")
    steps = -(-int(n_samples) // walkers)
    if steps < 2:
        raise ParameterError(f"{n_samples} samples are fewer than two steps of {walkers} walkers")
    seed = int(generator(rng).integers(2**32))
    begin = model.start(np.random.default_rng(seed), walkers)
    run = Run(model, begin, seed, steps, progress, save_every)
    if checkpoint is not None:
        check_writable(checkpoint)
        spin_said = f"{spin.value} {spin.sigma}" if isinstance(spin, Vector) else str(spin)
        identity = fingerprint(field, given.describe() | {
            "cosmology": repr(cosmology), "spin": spin_said, "outliers": repr(outliers),
            "outlier width": str(outlier_width), "walkers": str(walkers), "seed": str(seed),
        })  # fmt: skip
        run.resume_from(checkpoint, identity)
    chain, log_probability = run.run()
    return Posterior(chain, log_probability, model, field.frame, field.notes, seed)
