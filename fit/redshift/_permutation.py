"""Permutation tests of bins: redshifts dealt out anew among the sources."""

from __future__ import annotations

import numpy as np

from fit.distances import calibrate_if_known, mean_rates
from fit.redshift._contrasts import equality_chi2, slope_chi2
from fit.redshift._shared import FLOW_MATTERS
from fit.redshift._solution import BinnedSolution
from vsh.basis import harmonics
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import Rng
from vsh.cosmology import velocity_along, with_redshift
from vsh.errors import ParameterError
from vsh.field import Field
from vsh.modes import KINDS, Modes
from vsh.sky.sphere import triad
from vsh.vector import Vector


@arguments.accepts(
    field=arguments.a(Field), binned=arguments.a(BinnedSolution), n_permutations=arguments.whole, rng=arguments.seed
)
def permutation_test(
    field: Field,
    binned: BinnedSolution,
    *,
    n_permutations: int = 1000,
    rng: Rng = 1,
    velocity: Vector | None = None,
    redshift_frame: str | None = None,
    peculiar_dispersion: float | None = None,
) -> dict[str, float]:
    """p-values by permutation: how often permuted redshifts give bins that differ at least as much.

    Positions, motions and errors stay together; the redshifts are permuted. Before that, the errors of each
    source are multiplied by the √(χ²/dof) of its bin, and in every permutation those of each bin by its own:
    so the test holds where errors are wrong in a way that depends on redshift, as a permutation of
    statistics that are studentised does (Janssen 1997, Stat. Probab. Lett. 36, 9). For degree 1.

    Parameters
    ----------
    field : Field
        That went into the bins.
    binned : BinnedSolution
        Of degree 1.
    n_permutations : int
        How many.
    rng : Generator or int
        The source of all randomness.
    velocity : Vector, optional
        Ours [km/s]: tests "secular_parallax" as well, whether the bins contradict a constant
        acceleration with the secular parallax of that velocity.
    redshift_frame, peculiar_dispersion
        As for `fit.redshift.binned`: for the distances of the secular parallax.

    Returns
    -------
    dict of str to float
        "T" and "S": equality of spin and acceleration; "trend": no slope of both with redshift; "secular_parallax".

    Raises
    ------
    ParameterError
        If the bins are not of degree 1, or of galaxies near enough for flows that they share.

    Notes
    -----
    Permuting assumes that without a signal a source's motion has nothing to do with its redshift. It fails
    where the sky has degrees above 1 that are the same at all redshifts *and* redshifts depend on the place
    (two surveys of different depth): a dipole then leaks into the bins, by place. Bins with a higher degree
    in common (`binned(…, shared_higher_degrees=True)`) take such a field out. It fails as well for near galaxies, whose
    flows neighbours share: one for a true constant velocity came out at p = 0.001 on every sky.
    """
    if binned.modes.lmax != 1:
        raise ParameterError(f"permutations are for bins of degree 1, not {binned.modes.lmax}")
    if binned.flow_share > FLOW_MATTERS:
        raise ParameterError(
            "redshifts dealt out anew tear flows apart that near galaxies share, and every p-value is then too small: the "
            "bins' own tests hold them (or permute bins that were fitted with flows=None)"
        )
    rng = generator(rng)
    field = with_redshift(field, 0.0)
    calibration = None if velocity is None else calibrate_if_known(field, redshift_frame, peculiar_dispersion)
    redshift = np.asarray(field.redshift)
    place = np.searchsorted(binned.edges, redshift, side="right") - 1
    inside = (place >= 0) & (place < len(binned))
    field, place = field[inside], place[inside]
    field = field.with_errors(field.sigma * np.sqrt(binned.scales)[place])
    motions = [field.motion]
    if velocity is not None:
        motions.append(field.motion - _parallax(field, velocity, calibration))
    rows = np.concatenate([harmonics(field.lon, field.lat, Modes(1)), np.stack(motions)])
    a, b, c = field.weights
    weighted = np.stack([a * rows[:, 0] + c * rows[:, 1], c * rows[:, 0] + b * rows[:, 1]], axis=1)
    # N, the right-hand sides, and χ² of nothing, of each source.
    products = np.einsum("ikn,jkn->nij", rows, weighted)
    size = products.shape[1]
    products = products.reshape(len(field), -1)
    counts: dict[str, int] = {}
    observed: dict[str, float] = {}
    for _ in range(n_permutations + 1):
        sums = np.stack([np.bincount(place, column, len(binned)) for column in products.T], axis=1)
        sums = sums.reshape(-1, size, size)
        found = _statistics(sums, np.bincount(place, minlength=len(binned)), binned, velocity is not None)
        if not observed:
            observed, counts = found, dict.fromkeys(found, 0)
        for name, chi2 in found.items():
            counts[name] += chi2 >= observed[name] * (1 - 1e-12)
        place = rng.permutation(place)
    return {name: count / (n_permutations + 1) for name, count in counts.items()}


def _statistics(sums, sources, binned, with_velocity):
    degree = {kind: np.arange(6)[Modes(1).slice_of(kind, 1)] for kind in KINDS}
    values, covariance = _solved(sums, sources, 6)
    found = {kind: equality_chi2(values[:, at], covariance[:, at][:, :, at]) for kind, at in degree.items()}
    if len(binned) > 1:
        found["trend"] = slope_chi2(values, covariance, binned.redshift)
    if with_velocity:
        values, covariance = _solved(sums, sources, 7)
        at = degree["S"]
        found["secular_parallax"] = equality_chi2(values[:, at], covariance[:, at][:, :, at])
    return found


def _solved(sums, sources, column):
    """Coefficients of each bin, and their covariance times the bin's χ²/dof."""
    inverse = np.linalg.inv(sums[:, :6, :6])
    rhs = sums[:, :6, column]
    values = np.einsum("bij,bj->bi", inverse, rhs)
    chi2, dof = sums[:, column, column] - np.sum(values * rhs, 1), 2 * sources - 6
    scale = np.where(dof > 0, chi2 / np.maximum(dof, 1), 1.0)
    return values, inverse * scale[:, None, None]


def _parallax(field, velocity, calibration):
    """The motions by our velocity, (2, n); none within the flow. [µas/yr]"""
    velocity = velocity_along(velocity, field.frame).value
    p, q, _ = triad(field.lon, field.lat)
    return -np.stack([velocity @ p, velocity @ q]) * mean_rates(field, calibration)
