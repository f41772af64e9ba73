"""The equations of the secular parallax by our own motion, and their sums for any spread of peculiar velocities.

A source at transverse comoving distance d moves by

    µ = −u_⊥ k + ã_⊥ + ω × r,   k = 1/d_P,   u = v H0/H_ref,

(Bachchan, Hobbs & Lindegren 2016, sect. 2.3 and 4), where distances are those for H_ref: the data see the product v H0
only. Where redshifts hold velocities and errors, k is the mean of 1/d (`fit.distances`), and its variance s² adds s²
|v|²/3 to that of the motion, and with flows s² σ² for theirs. Each source is turned to the axes of its error ellipse,
in which a variance that is the same in all directions (peculiar velocities, excess noise) is simply added.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from fit.distances import Calibration, inverse_distances
from fit.secular_parallax._flow import FlowRows, known_flow
from vsh.field import Field
from vsh.io.parts import DISTANCES, Parts
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, hubble_value, parallax_factor
from vsh.models.flows import FlowModes, LinearTheory, VelocityGrid
from vsh.sky.sphere import triad
from vsh.tools.errors import FrameError
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, FloatArray
from vsh.tools.units import AU_PER_YEAR

#: u: our velocity were H0 what the cosmology has [km/s]; ã and ω [µas/yr]; v of those with distances in Mpc [km/s].
U, A, OMEGA, V = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
#: Sources whose flow is computed at once.
_BLOCK = 512
#: Distances surer than this leave no room for magnitudes to tell near from far: sources weigh by their own errors.
_SURE = 0.05


@dataclass(frozen=True, eq=False)
class ParallaxSums:
    """N θ = b for θ = (u, ã, ω), with what a likelihood needs besides."""

    matrix: FloatArray
    rhs: FloatArray
    chi2_null: FloatArray
    logdet: FloatArray
    n_data: int

    def __add__(self, other: ParallaxSums) -> ParallaxSums:
        return ParallaxSums(*(getattr(self, entry.name) + getattr(other, entry.name) for entry in fields(self)))


@dataclass(frozen=True, eq=False)
class ParallaxEquations:
    """Uncorrelated equations, two a source."""

    design: FloatArray
    motion: FloatArray
    variance: FloatArray
    rate: FloatArray
    left: FloatArray
    hubble: float
    frame: str
    notes: tuple[str, ...]
    flow: FlowRows | None = None
    n_own: int = 0
    left_out: Any = None

    @property
    def n_data(self) -> int:
        """How many equations: two a source."""
        return len(self.motion)

    @property
    def modes(self) -> FlowModes | None:
        """Modes of the flow."""
        return None if self.flow is None else self.flow.modes

    @property
    def smallest_variance(self) -> float:
        """The smallest variance of all equations. [(µas/yr)²]"""
        return float(self.variance.min())

    @property
    def largest_rate(self) -> float:
        """The largest rate of all equations. [µas/yr per km/s]"""
        return float(self.rate.max())

    def most_sensitive(self, n_sources: int) -> ParallaxEquations:
        """Those of so many sources whose motions tell most of peculiar velocities, by distance and error alone."""
        n = self.n_data // 2
        if n <= n_sources:
            return self
        share = self.rate[:n] ** 2 * (1 / self.variance[:n] + 1 / self.variance[n:])
        chosen = np.sort(np.argpartition(-share, n_sources)[:n_sources])
        both = np.r_[chosen, chosen + n]
        flow = None if self.flow is None else self.flow.only(chosen[chosen < len(self.flow.lon)])
        columns = {name: getattr(self, name)[both] for name in ("design", "motion", "variance", "rate", "left")}
        return replace(self, **columns, flow=flow)

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, ratio: float = 1.0, threads: int | None = None
    ) -> ParallaxSums:
        """Normal equations with variances V = σ² + (spread k)² + excess_noise², and what a flow's modes leave."""
        spread, excess_noise = np.broadcast_arrays(spread, excess_noise)
        added = np.stack([np.ravel(spread), np.ravel(excess_noise)]) ** 2
        many, n = added.shape[1], self.n_data // 2
        size = self.design.shape[1] + 1
        near = 0 if self.flow is None else len(self.flow.lon)
        far = np.r_[near:n, n + near : 2 * n]

        def weighted(index, further):
            base = self.variance[index, None] + self.left[index, None] * ratio**2
            variance = self.rate[index, None] ** 2 * added[0] + (base + added[1])
            rows = np.concatenate([self.design[index].T, self.motion[index][None], *further])
            return _gram(rows, variance), np.log(variance).sum(0)

        def near_block(part):
            assert self.flow is not None
            return weighted(np.r_[part, slice(n + part.start, n + part.stop)], [self.flow.rows(part).T])

        def far_block(part):
            return weighted(far[part], [])

        total = size + (0 if self.modes is None else len(self.modes))
        gram: Any = np.zeros((many, total, total))
        logdet: Any = np.zeros(many)
        if near:
            for each, log in map_blocks(near_block, near, _BLOCK, threads):
                gram, logdet = gram + each, logdet + log
        if far.size:
            for each, log in map_blocks(far_block, far.size, max(64, 2**20 // max(55, many)), threads):
                gram[:, :size, :size] += each
                logdet = logdet + log
        order = np.r_[: size - 1, size:total, size - 1]  # the motion last
        gram = gram[:, order[:, None], order].reshape(*spread.shape, len(order), len(order))
        shaped: Any = logdet.reshape(spread.shape)
        return ParallaxSums(gram[..., :-1, :-1], gram[..., :-1, -1], gram[..., -1, -1], shaped, self.n_data)


def _gram(rows, variance):
    """Σ rows rowsᵀ/V for every column of variances, (m, k, k); rows are (k, n)."""
    k, many = len(rows), variance.shape[1]
    if k <= 16:
        upper = np.triu_indices(k)
        products = rows[upper[0]] * rows[upper[1]]  # weighted, for every spread at once, by one product
        sums = (products @ (1 / variance)).T
        out = np.empty((many, k, k))
        out[:, upper[0], upper[1]] = sums
        out[:, upper[1], upper[0]] = sums
        return out
    out = np.empty((many, k, k))
    for i, each in enumerate(variance.T):
        scaled = rows / np.sqrt(each)
        out[i] = scaled @ scaled.T
    return out


def equations_of(
    field: Field,
    calibration: Calibration,
    *,
    theory: LinearTheory | None = None,
    modes: FlowModes | None = None,
    ratio: float = 1.0,
    apart: bool = False,
    reconstruction: VelocityGrid | None = None,
    threads: int | None = None,
) -> ParallaxEquations:
    """The equations of a field."""
    k = inverse_distances(field, calibration, threads)
    distance = k.distance * calibration.little_h
    mean, y, notes = k.mean, field.motion, field.notes
    if reconstruction is not None:
        across, shift, note = known_flow(reconstruction, field, distance, k.slope)
        mean = mean + np.clip(shift, -mean / 2, mean)
        y, notes = y - across * mean * np.where(k.own, 1.0, ratio), (*notes, *note)
    scale = np.where(k.own, ratio, 1.0)  # what is in Mpc moves by v/d, not by u/d
    mean, variance_of_k = mean / scale, k.variance / scale**2
    p, q, _ = triad(field.lon, field.lat)
    cos, sin, large, small = _axes(field, calibration, k)
    own = np.where(k.own & apart, 1.0, 0.0)
    # Our own motion moves sources by v/d_P, which in curved space is another distance than d_M.
    seen = mean * parallax_factor(1 / (AU_PER_YEAR * np.where(k.own, k.mean / ratio, k.mean)), calibration.cosmology)
    ours_east, ours_north = (-seen * (1 - own) * each for each in (p, q))
    columns = [[ours_east, p, q], [ours_north, q, -p]]
    if apart:
        columns[0].append(-seen * own * p)
        columns[1].append(-seen * own * q)
    east, north = map(np.concatenate, columns)
    ours = CMB_VELOCITY_PLANCK18.to_frame(field.frame).value
    unsure, flow, left, order = ours @ ours / 3, None, np.zeros(len(field)), np.arange(len(field))
    if theory is not None:
        unsure += theory.sigma**2
        left = np.full(len(field), theory.sigma**2)
    if modes is not None:
        near = distance <= modes.radii[-1]
        order = np.argsort(~near, kind="stable")
        first = order[: near.sum()]
        left[near] = modes.left(distance[near])[0]
        flow = FlowRows(modes, *(each[first] for each in (field.lon, field.lat, distance, mean, cos, sin)))
    rate = np.sqrt(mean**2 + variance_of_k)
    scatter, left = variance_of_k * unsure, left * rate**2
    pairs = [
        np.concatenate([cos * east + sin * north, cos * north - sin * east], axis=1).T,
        np.concatenate([cos * y[0] + sin * y[1], cos * y[1] - sin * y[0]]),
        np.concatenate([large + scatter, small + scatter]),
        np.concatenate([rate, rate]),
        np.concatenate([left, left]),
    ]
    if modes is not None:
        both = np.r_[order, order + len(field)]
        pairs = [pair[both] for pair in pairs]
    design, motion, variance, rates, lefts = pairs
    return ParallaxEquations(
        design,
        motion,
        variance,
        rates,
        lefts,
        hubble_value(calibration.cosmology),
        field.frame,
        (*notes, *calibration.notes),
        flow,
        int(k.own.sum()),
    )


def _axes(field, calibration, k):
    """Direction and variances of error ellipses; circles where distances are unsure and only redshifts may weigh."""
    (s1, s2), rho = field.sigma**2, field.rho
    if calibration.errors is not None:
        unsure = ~k.own & (np.sqrt(k.variance) > _SURE * k.mean)
        mean = calibration.errors.at(k.redshift)
        s1, s2, rho = np.where(unsure, mean, s1), np.where(unsure, mean, s2), np.where(unsure, 0.0, rho)
    covariance = rho * np.sqrt(s1 * s2)
    angle = np.arctan2(2 * covariance, s1 - s2) / 2
    mean, half = (s1 + s2) / 2, np.hypot((s1 - s2) / 2, covariance)
    large = mean + half
    small = s1 * s2 * (1 - rho**2) / large  # mean − half would cancel
    return np.cos(angle), np.sin(angle), large, small


@dataclass(frozen=True, eq=False)
class ParallaxParts:
    """The same of a catalogue in parts: the equations stay where the parts are, sums come back."""

    sky: Parts
    calibration: Calibration
    options: dict[str, Any]
    n_data: int
    smallest_variance: float
    largest_rate: float
    hubble: float
    frame: str
    notes: tuple[str, ...]
    n_own: int
    left_out: Any = None

    @property
    def modes(self) -> FlowModes | None:
        """Those of the flow."""
        return self.options.get("modes")

    @classmethod
    def of(cls, sky: Parts, calibration: Calibration, options: dict[str, Any]) -> ParallaxParts:
        """The equations of a catalogue in parts."""
        work = partial(_facts_of, calibration=calibration, options=options)
        facts = sky.sum(work, roles=DISTANCES, words="redshifts")
        if len(facts["frames"]) > 1:
            raise FrameError(f"parts are in {' and '.join(sorted(facts['frames']))}: take all to one frame")
        return cls(
            sky,
            calibration,
            options,
            facts["n_data"],
            min(facts["variance"]),
            max(facts["rate"]),
            hubble_value(calibration.cosmology),
            next(iter(facts["frames"])),
            merge_notes(*facts["notes"]),
            facts["n_own"],
        )

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, ratio: float = 1.0, threads: int | None = None
    ) -> ParallaxSums:
        """As `ParallaxEquations.sums`."""
        given = {"spread": spread, "excess_noise": excess_noise, "ratio": ratio, "threads": threads}
        work = partial(_sums_of, calibration=self.calibration, options=self.options, given=given)
        return self.sky.sum(work, roles=DISTANCES, words="secular parallax")


def _facts_of(field, calibration, options):
    rows = equations_of(field, calibration, **options)
    return {
        "n_data": rows.n_data,
        "variance": [rows.smallest_variance],
        "rate": [rows.largest_rate],
        "frames": {rows.frame: None},
        "notes": [rows.notes],
        "n_own": rows.n_own,
    }


def _sums_of(field, calibration, options, given):
    return equations_of(field, calibration, **options).sums(**given)


def equations(field: Field | Parts, calibration: Calibration, **options: Any) -> ParallaxEquations | ParallaxParts:
    """The equations of a field or of parts."""
    if isinstance(field, Parts):
        return ParallaxParts.of(field, calibration, options)
    return equations_of(field, calibration, **options)
