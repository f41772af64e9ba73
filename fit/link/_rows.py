"""What rows of several catalogues tell of frames whatever the sources' true parameters are."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fit.link._unknowns import Unknowns
from vsh.sky.astrometry import AstrometryRows
from vsh.sky.propagation import earth, propagate
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, FieldError
from vsh.tools.printing import in_a_line
from vsh.tools.types import FloatArray, IntArray
from vsh.tools.units import AU_PER_YEAR, UAS
from vsh.vector import Vector

#: Singular values of a source's whitened equations below so much of the largest are none.
_RANK = 1e-9
#: Positions farther from what was expected than so much are of another source. [rad]
_FAR = np.radians(1 / 60)
#: Sources that are eliminated together.
_TOGETHER = 4096


@dataclass(frozen=True, eq=False)
class Rows:
    """Differences that hold no true parameter, of unit variance and independent of each other.

    Attributes
    ----------
    design, rhs : (m, p) and (m,) arrays
        rhs = design · x + noise.
    source : (m,) int array
        The source of each.
    names : tuple of str
        The sources that tell anything.
    magnitude : (n,) array
    rows : (n,) int array
        How many rows of the catalogues each source has.
    log_determinant : float
        Half of that of the covariances of the differences: what unit variance leaves out of a likelihood.
    """

    design: FloatArray
    rhs: FloatArray
    source: IntArray
    names: tuple[str, ...]
    magnitude: FloatArray
    rows: IntArray
    log_determinant: float

    @cached_property
    def dims(self) -> IntArray:
        """How many differences each source has."""
        return np.bincount(self.source, minlength=len(self.names))

    @property
    def parts(self) -> list[slice]:
        """Where the differences of each source are: they stand together."""
        ends = np.cumsum(self.dims)
        return [slice(end - size, end) for end, size in zip(ends.tolist(), self.dims.tolist(), strict=True)]


class _Left(NamedTuple):
    """What one group leaves: its number, differences of unit variance, and half of ln of the determinant."""

    group: int
    design: FloatArray
    rhs: FloatArray
    size: float


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of every row, before true parameters are eliminated.

    Attributes
    ----------
    rows : tuple of (j, ) int arrays
        The rows of the astrometry that each source has, or all sources of one calibrator together.
    residual : (n, 5), design : (n, 5, p), truth : (n, 5, 5) arrays
        For each row: measured less expected, and derivatives by the frame and by the source's true parameters.
    data : AstrometryRows
    """

    rows: tuple[IntArray, ...]
    residual: FloatArray
    design: FloatArray
    truth: FloatArray
    data: AstrometryRows

    @cached_property
    def source(self) -> IntArray:
        """The number of each row's source."""
        return self.data.source

    def eliminated(self, excess: float = 0.0, across: float = 1.0, reference: str = "") -> Rows:
        """The differences that are left, with an offset of `excess` between the reference and the others added.

        Along the jet where there is one and `across` times as much across it, the same in all rows of the reference
        that are of one source, or of one calibrator.
        """
        left = [piece for some in self._alike for piece in self._left(some, excess, across, reference)]
        left = [each for each in left if each.design.size and np.abs(each.design).max() > 0]
        left.sort(key=lambda each: each.group)
        if not left:
            first = {each: self.data.name[self.data.catalogue == each][0] for each in self.data.catalogues}
            called = ", ".join(f"{name} in {each}" for each, name in first.items())
            raise DegeneracyError(
                "no source tells anything of the frame: none is in two catalogues, and none is a quasar with a motion "
                f"(sources are matched by name: {called} …)"
            )
        groups = [self.rows[each.group] for each in left]
        return Rows(
            np.concatenate([each.design for each in left]),
            np.concatenate([each.rhs for each in left]),
            np.repeat(np.arange(len(left)), [len(each.rhs) for each in left]),
            tuple(map(self._called, groups)),
            np.array([self._magnitude(rows) for rows in groups]),
            np.array([len(rows) for rows in groups]),
            float(sum(each.size for each in left)),
        )

    @cached_property
    def _alike(self):
        """Groups whose rows measure the same, of the same catalogues and sources: their equations have one shape."""
        measured = self.data.measured
        catalogue = np.unique(self.data.catalogue, return_inverse=True)[1].ravel()
        alike: dict[Any, list[int]] = {}
        for k, rows in enumerate(self.rows):
            which = np.unique(self.source[rows], return_inverse=True)[1] if len(rows) > 1 else np.zeros(1, int)
            key = measured[rows].tobytes(), catalogue[rows].tobytes(), which.tobytes()
            alike.setdefault(key, []).append(k)
        return [
            np.array(members[i : i + _TOGETHER])
            for members in alike.values()
            for i in range(0, len(members), _TOGETHER)
        ]

    def _left(self, members, excess, across, reference):
        """What is left of groups of one shape when their true parameters are eliminated."""
        data, rows = self.data, np.array([self.rows[k] for k in members])
        keep = data.measured[rows[0]]
        n, m = len(rows), int(keep.sum())
        sigma = np.zeros((n, m, m))
        at = np.cumsum([0, *keep.sum(1)])
        for j, mask in enumerate(keep):
            sigma[:, at[j] : at[j + 1], at[j] : at[j + 1]] = data.covariance[rows[:, j]][:, mask][:, :, mask]
        if excess:
            jets = data.jet[rows]
            known = np.isfinite(jets)
            some, first = known.any(1), jets[np.arange(n), known.argmax(1)]
            angle, ratio = np.where(some, first, 0.0), np.where(some, across, 1.0)
            sin, cos = np.sin(angle), np.cos(angle)
            offset = np.zeros((n, *keep.shape, 2))
            theirs = data.catalogue[rows[0]] == reference
            turned = np.array([[sin, ratio * cos], [cos, -ratio * sin]])
            offset[:, theirs, :2] = excess * np.moveaxis(turned, 2, 0)[:, None]
            flat = offset[:, keep]
            sigma += flat @ flat.transpose(0, 2, 1)
        factor = np.linalg.cholesky(sigma)
        a, y = np.linalg.solve(factor, self.design[rows][:, keep]), self.residual[rows][:, keep]
        y = np.linalg.solve(factor, y[..., None])[..., 0]
        size = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
        truth = self._truths(rows)[:, keep]
        length = np.linalg.norm(truth, axis=1, keepdims=True)
        if truth.size:
            u, s, _ = np.linalg.svd(np.linalg.solve(factor, truth / np.where(length > 0, length, 1.0)))
            kept = (s > _RANK * s[:, :1]) & (s > 0)
        else:
            u, s, kept = np.tile(np.eye(m), (n, 1, 1)), np.ones((n, 0)), np.zeros((n, 0), bool)
        size += np.log(np.where(kept, s, 1.0)).sum(1)
        for i, rank in enumerate(kept.sum(1)):
            free = u[i, :, rank:].T
            yield _Left(int(members[i]), free @ a[i], free @ y[i], float(size[i]))

    def _magnitude(self, rows):
        """That of a source, or the mean of several."""
        known = self.data.magnitude[rows][np.isfinite(self.data.magnitude[rows])]
        return known.mean() if known.size else np.nan

    def _truths(self, rows):
        """Derivatives by the true parameters of all sources that stand together, (n, j, 5, 5 s)."""
        which = np.unique(self.source[rows[0]], return_inverse=True)[1].ravel()
        out = np.zeros((*rows.shape, 5, which.max() + 1, 5))
        out[:, np.arange(len(which)), :, which] = np.moveaxis(self.truth[rows], 1, 0)
        return out.reshape(*rows.shape, 5, -1)

    def _called(self, rows):
        """The name of a source, or of the first of several and how many more there are."""
        sources = np.unique(self.source[rows])
        first = str(self.data.name[rows[0]])
        return first if len(sources) == 1 else f"{first} and {len(sources) - 1} more"


def equations(
    data: AstrometryRows,
    unknowns: Unknowns,
    *,
    fixed: Mapping[str, float],
    aberration: Vector | None,
    parallax: bool = True,
    light_time: bool = True,
) -> tuple[Equations, tuple[str, ...]]:
    """Expected parameters of each row from the best-known ones of its source, and what is left; with notes."""
    number, n = data.source, len(data)
    order = np.argsort(number, kind="stable")
    groups = tuple(np.split(order, np.flatnonzero(np.diff(number[order])) + 1))
    together = _of_one_calibrator(data, groups)
    # The colour and the magnitude of a source are those of any of its rows.
    values = {role: np.full(n, np.nan) for role in ("magnitude", "colour", "radial_velocity")}
    start = np.zeros((5, n))
    epoch = np.zeros(n)
    still = np.zeros(n, bool)
    measured = data.measured
    for rows in groups:
        for role, column in values.items():
            known = getattr(data, role)[rows]
            known = known[np.isfinite(known)]
            column[rows] = known[0] if known.size else np.nan
        still[rows] = data.still[rows].any()
        first = rows[np.argmax(measured[rows].sum(1) + 0.5 * np.isfinite(data.lon[rows]))]
        if not np.isfinite(data.lon[first]):
            raise FieldError(f"no row of {in_a_line(data.name[first])} has a position, if without an error")
        start[0, rows], start[1, rows], epoch[rows] = data.lon[first], data.lat[first], data.epoch[first]
        if not still[rows[0]]:
            for k in (2, 3, 4):
                with_it = rows[np.isfinite(data.values[k, rows])]
                place = first if np.isfinite(data.values[k, first]) else with_it[0] if with_it.size else -1
                start[k, rows] = data.values[k, place] if place >= 0 else 0.0
    notes = _moving_without_velocity(data, values["radial_velocity"], still)
    later, jacobian = propagate(
        start, np.nan_to_num(values["radial_velocity"]), epoch, data.epoch, light_time=light_time
    )
    p, q, r = triad(later[0], later[1])
    _, _, there = triad(np.where(measured[:, 0], data.lon, later[0]), np.where(measured[:, 0], data.lat, later[1]))
    if (np.sum(there * r, 0) < np.cos(_FAR)).any():
        bad = np.flatnonzero(np.sum(there * r, 0) < np.cos(_FAR))
        raise FieldError(
            f"positions more than 1' from where the source should be: {len(bad)} ({in_a_line(data.name[bad[0]])} in "
            f"{data.catalogue[bad[0]]}, row {bad[0]}): names that are given twice, or a wrong epoch or motion"
        )
    residual = np.stack(
        [np.sum(p * there, 0) / UAS, np.sum(q * there, 0) / UAS, data.parallax - later[2], *(data.motion - later[3:])]
    ).T
    truth = jacobian.copy()
    truth[still, :, 2:] = 0.0
    if parallax and (data.displaced & measured[:, 0]).any():
        b = earth(data.epoch)
        factors = -np.stack([np.sum(p * b, 0), np.sum(q * b, 0)])
        factors[:, ~data.displaced] = 0.0
        residual[:, :2] -= (factors * later[2]).T
        truth[:, :2, 2] += factors.T * np.where(still, 0.0, 1.0)[:, None]
    functions = unknowns.functions(values["magnitude"], values["colour"])
    design = np.zeros((n, 5, len(unknowns.names)))
    for catalogue in data.catalogues:
        mine = data.catalogue == catalogue
        design[mine] = unknowns.design(later[0, mine], later[1, mine], data.epoch[mine], functions[:, mine], catalogue)
    if np.isnan(design).any():
        lost = data.name[np.isnan(design).any((1, 2))]
        raise FieldError(
            f"{len(np.unique(lost))} sources have no magnitude or colour, which the frame is to depend on: "
            f"{in_a_line(lost[0])} for one"
        )
    # Apparent motions follow the acceleration of the Solar System. A catalogue that is fixed to calibrators at an
    # epoch does not: there stars move against it.
    shift = np.zeros((n, 5, 3))
    axes = np.stack([p.T, q.T], 1)
    quasars = still & measured[:, 3]
    shift[quasars, 3:] += axes[quasars]
    shift[still, :2] += (data.epoch - epoch)[still, None, None] * axes[still]
    for catalogue, when in fixed.items():
        mine = data.catalogue == catalogue
        shift[mine & ~still, :2] -= (data.epoch - when)[mine & ~still, None, None] * axes[mine & ~still]
        shift[mine & ~still, 3:] -= axes[mine & ~still]
    if "acceleration" in unknowns.vectors:
        design[:, :, -3:] = shift
    elif aberration is not None:
        residual -= shift @ aberration.to_frame("icrs").value
    residual[~measured] = 0.0
    return Equations(together, residual, design, truth, data), notes


def _of_one_calibrator(data, groups):
    """Rows of sources that share a calibrator, joined: its error is in all of them."""
    named = data.calibrator != ""
    if not named.any():
        return groups
    called, place = np.unique(data.calibrator[named], return_inverse=True)
    graph = coo_array(
        (np.ones(int(named.sum())), (data.source[named], place.ravel())), shape=(len(groups), len(called))
    ).tocsr()
    _, part = connected_components(graph @ graph.T, directed=False)
    return tuple(
        np.concatenate([groups[k] for k in np.flatnonzero(part == each)]) for each in dict.fromkeys(part.tolist())
    )


def _moving_without_velocity(data, velocity, still):
    """A note on fast stars near us whose radial velocity is not known."""
    with np.errstate(invalid="ignore"):
        # Perspective acceleration of 50 km/s over twenty years, 2 µ v ϖ t / A. [µas/yr]
        change = np.hypot(*data.motion) * 50 * data.parallax * UAS * 2 * 20 / AU_PER_YEAR
        doubtful = np.unique(data.name[~still & np.isnan(velocity) & (change > 20)])
    if not doubtful.size:
        return ()
    return (
        f"warning: {doubtful.size} near, fast stars without a radial velocity, {in_a_line(doubtful[0])} for one: "
        "50 km/s change their motion by more than 20 µas/yr in twenty years",
    )
