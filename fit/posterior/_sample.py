"""Posteriors of our velocity and the Hubble constant, by Markov chains (emcee) or on a grid."""

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from logging import getLogger
from time import perf_counter
from typing import Any, Literal

import numpy as np

from fit.distances import declared_frame
from fit.posterior._model import make_parallax_model
from fit.posterior._posterior import Cells, Posterior, check_grid_possible, make_cells_if_possible
from fit.posterior._priors import ModelPriors, Priors, check_priors, make_priors
from fit.posterior._sampling import Prior, Run, check_checkpoint_writable, identify_function, make_fingerprint
from fit.results.storage import Result
from fit.secular_parallax import (
    ASSUMED,
    OMEGA,
    DistanceModel,
    ParallaxEquations,
    ParallaxParts,
    compute_flow_covariance,
    make_local_group,
    make_notes_on_local_group,
    warn_of_undeclared_frame,
)
from vsh.field import MEASURED, Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.io.sections import Section
from vsh.tools import arguments
from vsh.tools.arguments import choice, generator
from vsh.tools.digits import format_values, format_with_error
from vsh.tools.errors import ParameterError
from vsh.tools.files import hold_lock
from vsh.tools.printing import log_result
from vsh.tools.types import AxesArray, Cosmology, FloatArray, OnAxes, PathName, Rng, Table
from vsh.vector import Vector


def _select_distance_options(options):
    """Select what is assumed of distances; a dispersion may have a prior, and is not of it."""
    return {name: value for name, value in options.items() if name in ASSUMED and name != "peculiar_dispersion"}


def make_equations_and_priors(
    field: Field | Parts, priors: Priors, cosmology: Cosmology | None, options: Mapping[str, Any]
) -> tuple[ParallaxEquations | ParallaxParts, ModelPriors]:
    """The equations of a catalogue, and the priors along its axes."""
    distance_model = DistanceModel(cosmology=cosmology, **_select_distance_options(options))
    first_field = field if isinstance(field, Field) else next(iter(field))
    model_priors = check_priors(priors, first_field.frame, distance_model)
    system = replace(distance_model, peculiar_dispersion=model_priors.typical_dispersion).equations(field)
    if system.n_own:
        raise ParameterError(
            f"{system.n_own} sources have distances in Mpc, of which the motions tell v, not v · H0: the posterior "
            "takes redshifts alone. Leave those distances out, or fit with fit.secular_parallax.observer_velocity"
        )
    system = warn_of_undeclared_frame(system, field, distance_model.redshift_frame)
    if system.left_out is not None:
        system = replace(system, notes=(_format_omitted_flow_note(system, model_priors), *system.notes))
    group = make_local_group(priors.local_group, system)
    if group is not None and "flow_amplitude" in model_priors.free:
        raise ParameterError("the Local Group tells a flow of known amplitude: leave out local_group or flow_amplitude")
    if system.modes is not None:
        flows = f"{len(system.modes)} modes of {system.modes.theory.name}" + (", and the Local Group" if group else "")
        model_priors = replace(model_priors, flows=flows, group=group)
    frame = distance_model.redshift_frame or declared_frame(first_field)
    system = replace(system, notes=(*system.notes, *make_notes_on_local_group(system, priors.local_group, frame)))
    return system, model_priors


def _format_omitted_flow_note(equations, model_priors):
    """Note on what omitted flows would add."""
    sums = equations.left_out.sums(model_priors.typical_dispersion, 0.0, equations.n_data // 2)
    flow_errors = np.sqrt(np.diag(compute_flow_covariance(sums, np.eye(9)[:, : OMEGA.start], 1.0)))
    return (
        "warning: not in the intervals: flows of linear theory, which galaxies share, add about "
        f"± {np.sqrt(np.mean(flow_errors[:3] ** 2)):.0f} km/s to each component of v H0/H_ref, and ± "
        f"{np.sqrt(np.mean(flow_errors[3:] ** 2)):.2g} µas/yr to the acceleration's"
    )


_LOG = getLogger(__name__)


@arguments.accepts(
    field=arguments.a(Field, Parts), n_samples=arguments.whole, rng=arguments.seed, n_walkers=arguments.whole
)
def sample(
    field: Field | Parts,
    velocity_prior: str | Vector | Callable[[FloatArray], FloatArray] | None = None,
    hubble_prior: str | tuple[float, float] | Prior | None = None,
    *,
    method: Literal["emcee", "grid"] = "emcee",
    n_samples: int = 100_000,
    max_samples: int | None = None,
    rng: Rng = 1,
    checkpoint: PathName | None = None,
    cosmology: Cosmology | None = None,
    n_walkers: int | None = None,
    progress: bool = True,
    threads: int | None = None,
    save_every: float = 5.0,
    **options: Any,
) -> Posterior:
    """Sample the posterior of our velocity and the Hubble constant, the acceleration marginalised.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4.
    velocity_prior, hubble_prior : as in `Priors`, optional
        "planck" and "flat" unless given.
    method : {"emcee", "grid"}
        "grid" gives independent samples, exact and at once, where H0 and one more number at most are free and the
        velocity's prior is Gaussian or flat; it needs no checkpoint.
    n_samples : int
        Steps times walkers, before burn-in and thinning, at least.
    max_samples : int, optional
        A chain that is shorter than 50 autocorrelation times goes on by itself, to at most so many: sixteen times
        `n_samples` unless given.
    rng : Generator or int
        The source of all randomness.
    checkpoint : str or Path, optional
        The chain is kept in this file (NumPy's npz, no pickles), and an interrupted run resumes
        from it. The result is the same, bit for bit, as without the interruption.
    cosmology : astropy cosmology, optional
        The shape of the distance.
    n_walkers : int, optional
        128 unless given.
    progress : bool
        Show a bar, after two seconds.
    threads : int, optional
        How many; one a core unless given.
    save_every : float
        Seconds between checkpoints, at least.
    **options
        The other attributes of `Priors`: peculiar_dispersion, flow_amplitude, local_group, acceleration,
        excess_noise, spin; and those of `fit.secular_parallax.DistanceModel`: redshift_frame, flows, …

    Raises
    ------
    ParameterError
        If a prior is none, neither of the two is proper, or the posterior has no integral.
    CheckpointError
        If the checkpoint belongs to another run, or is damaged.
    DegeneracyError, FieldError
        As for `fit.secular_parallax.observer_velocity`.

    Notes
    -----
    emcee (Foreman-Mackey et al. 2013, PASP 125, 306) with moves by differential evolution, one in ten of them from mode
    to mode (ter Braak 2006). Where the posterior is known on a grid, walkers start from draws of it, four moves of five
    are to a new draw, and the report has the grid's H0 beside the chain's.
    """
    choice("method", method, ("emcee", "grid"))
    priors = make_priors(velocity_prior, hubble_prior, options)
    equations, model_priors = make_equations_and_priors(field, priors, cosmology, options)
    spin = priors.spin
    if method == "grid":  # before the likelihood is tabulated
        check_grid_possible(model_priors)
        if checkpoint is not None:
            raise ParameterError("independent draws from a grid are made at once: they take no checkpoint")
    model: Any = make_parallax_model(equations, model_priors, spin, threads)
    n_walkers = n_walkers or 128
    if n_walkers < 2 * len(model.names):
        raise ParameterError(f"{n_walkers} walkers are too few for {len(model.names)} coordinates: take twice as many")
    n_steps = -(-int(n_samples) // n_walkers)
    if n_steps < 2:
        raise ParameterError(f"{n_samples} samples are too few: ask for at least {2 * n_walkers}")
    seed, begin_time = int(generator(rng).integers(2**32)), perf_counter()
    facts: Any = {"model": model, "frame": equations.frame, "notes": equations.notes, "seed": seed, "method": method}
    if method == "grid":
        theta, log_density = Cells.of(model).draw_independent(np.random.default_rng(seed), n_steps * n_walkers)
        chain, log_probability = theta.reshape(n_steps, n_walkers, -1), log_density.reshape(n_steps, n_walkers)
        return log_result(_LOG, "chain", Posterior(chain=chain, log_probability=log_probability, **facts), begin_time)
    cells, start_rng = make_cells_if_possible(model), np.random.default_rng(seed)
    start = model.draw_start(start_rng, n_walkers) if cells is None else cells.draw_independent(start_rng, n_walkers)[0]
    max_steps = 16 * n_steps if max_samples is None else int(max_samples) // n_walkers
    run = Run(model, start, seed, n_steps, progress, save_every, max_steps, None if cells is None else cells.propose)
    if checkpoint is not None:
        check_checkpoint_writable(checkpoint)
        spin_description = f"{spin.value} {spin.sigma}" if isinstance(spin, Vector) else str(spin)
        identity = make_fingerprint(
            _list_identifying_arrays(field, equations),
            f"{equations.n_data // 2} sources, {equations.frame}",
            model_priors.describe_exactly()
            | {
                "cosmology": repr(cosmology),
                "spin": spin_description,
                "distances": _describe_distance_options(_select_distance_options(options)),
                "walkers": str(n_walkers),
                "seed": str(seed),
            },
        )
    with nullcontext() if checkpoint is None else hold_lock(checkpoint):
        if checkpoint is not None:
            run.resume_from(checkpoint, identity)
        chain, log_probability = run.run()
    facts["cells"] = cells
    return log_result(_LOG, "chain", Posterior(chain=chain, log_probability=log_probability, **facts), begin_time)


def _list_identifying_arrays(field, equations):
    """The arrays that tell one catalogue from another: of the field, or the sums of its parts."""
    if isinstance(field, Field):
        arrays = [getattr(field, name) for name in ("lon", "lat", "motion", "sigma", "rho", "redshift")]
        return arrays + [getattr(field, name) for name in MEASURED[1:] if getattr(field, name) is not None]
    sums = equations.sums()
    return [sums.matrix, sums.rhs, sums.chi2_null, sums.logdet]


def _describe_distance_options(options):
    """Describe how distances follow from redshifts, the same text in every run."""
    return str(
        {
            name: identify_function(value) if callable(value) and not isinstance(value, type) else repr(value)
            for name, value in sorted(options.items())
        }
    )


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

    def _sections(self, long):
        v = self.velocity
        facts = [(name, format_with_error(self.mean(name), self.sigma(name))) for name in self.names]
        facts += [(f"v_{axis}", f"{x} km/s") for axis, x in zip("xyz", format_values(v.value, v.sigma), strict=True)]
        return (Section(f"Posterior on a grid ({v.frame} axes, velocity toward the apex)", facts),)

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
        other_axes = tuple(i for i in range(len(self.names)) if i != index)
        return self.axes[index], self.probability.sum(other_axes)

    def mean(self, name: str) -> float:
        """Posterior mean of the quantity `name`."""
        values, probabilities = self.marginal(name)
        return float(values @ probabilities)

    def sigma(self, name: str) -> float:
        """Posterior standard deviation of the quantity `name`."""
        values, probabilities = self.marginal(name)
        return float(np.sqrt((values - values @ probabilities) ** 2 @ probabilities))


@arguments.accepts(field=arguments.a(Field, Parts), n_points=arguments.whole)
def grid(
    field: Field | Parts,
    velocity_prior: str | Vector | Callable[[FloatArray], FloatArray] | None = None,
    hubble_prior: str | tuple[float, float] | Prior | None = None,
    *,
    cosmology: Cosmology | None = None,
    n_points: int = 400,
    threads: int | None = None,
    **options: Any,
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
    **options
        The other attributes of `Priors`; and those of `fit.secular_parallax.DistanceModel`.

    Raises
    ------
    ParameterError
        If more than two numbers are free, or the velocity's prior is a function.
    """
    priors = make_priors(velocity_prior, hubble_prior, options)
    equations, model_priors = make_equations_and_priors(field, priors, cosmology, options)
    check_grid_possible(model_priors)
    return summarise_cells(Cells.of(make_parallax_model(equations, model_priors, priors.spin, threads), n_points))


def summarise_cells(cells: Cells) -> GridPosterior:
    """Summarise the cells."""
    weight, cell_means = cells.probability.ravel(), cells.mean
    mean_velocity = weight @ cell_means
    offset = cell_means - mean_velocity
    covariance = np.einsum("n,nij->ij", weight, cells.covariance) + np.einsum("n,ni,nj->ij", weight, offset, offset)
    velocity = Vector(mean_velocity, covariance, cells.model.likelihood.frame, "km/s")
    return GridPosterior(tuple(cells.model.priors.free), cells.axes, cells.probability, velocity)
