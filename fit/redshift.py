"""Dipoles, or any degrees, in bins of redshift: do all sources see the same sky?"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from fit.normal import NormalEquations, as_modes, normal_equations
from fit.solution import Solution
from fit.solve import solve
from vsh import Coefficients, Field, tables
from vsh.coefficients import FIRST_DEGREE
from vsh.errors import DegeneracyError, ParameterError
from vsh.redshifts import FLOW_LIMIT, with_redshift
from vsh.vector import Vector


class Test(NamedTuple):
    """A χ² with its degrees of freedom, and the chance of as much or more."""

    chi2: float
    dof: int
    p: float


@dataclass(frozen=True, eq=False)
class Trend:
    """Coefficients that change linearly: c(x) = c_0 + slope (x − x_0).

    Attributes
    ----------
    slopes : (q,) array
        Of each coefficient that is free in every bin. [µas/yr per unit of x]
    covariance : (q, q) array
    test : Test
        Of no slope.
    misfit : Test
        Of the bins about the trend.
    spin, acceleration : Vector
        The slopes of degree 1 as vectors.
    """

    slopes: np.ndarray
    covariance: np.ndarray
    test: Test
    misfit: Test
    spin: Vector
    acceleration: Vector


@dataclass(frozen=True, eq=False, repr=False)
class BinnedSolution:
    """Solutions in bins of redshift with their joint covariance.

    Attributes
    ----------
    edges : (B + 1,) array
    solutions : list of B Solutions
        With `common="higher"` they share what is above degree 1.
    normals : list of B NormalEquations
        Their sum is that of all the sources.
    redshift : (B,) array
        Mean, weighted by information.
    counts : (B,) int array
        Sources.
    covariance : (B q, B q) array
        Of the q coefficients that are free in every bin, bin by bin.
    free : (q,) int array
        Their places among the modes.
    nearness : (B,) array
        Mean of 1/d_M of the sources beyond the flow, weighted by information; nan where there is
        none. [1/Mpc]
    notes : tuple of str
    """

    edges: np.ndarray
    solutions: list
    normals: list
    redshift: np.ndarray
    counts: np.ndarray
    covariance: np.ndarray
    free: np.ndarray
    nearness: np.ndarray
    notes: tuple

    def __len__(self):
        return len(self.solutions)

    def __repr__(self):
        return f"<BinnedSolution: {len(self)} bins, {self.counts.sum()} sources, degree {self.modes.lmax}>"

    @property
    def modes(self):
        return self.solutions[0].modes

    @property
    def frame(self):
        return self.solutions[0].frame

    def equality(self, kind=None, l=None):
        """Are all bins alike? χ² of their differences, with the full covariance.

        Parameters
        ----------
        kind : {"T", "S"}, optional — only these coefficients; both unless given
        l : int, optional — only this degree; all that is free unless given
        """
        values, covariance, _ = self._chosen(kind, l)
        (_, least), bins, q = _gls(values, covariance, np.ones((len(self), 1))), len(self), values.shape[1]
        return _test(least, (bins - 1) * q)

    def trend(self, x=None):
        """Do they change with x? A straight line through the bins.

        Parameters
        ----------
        x : (B,) array, optional — the bins' redshifts unless given; `nearness` makes it a drift
        """
        x = self.redshift if x is None else np.asarray(x, float)
        if x.shape != (len(self),) or not np.isfinite(x).all():
            raise ParameterError(f"a trend needs a finite x for each of the {len(self)} bins")
        if len(self) < 2 or np.ptp(x) == 0:
            raise ParameterError("a trend needs at least two bins")
        values, covariance, free = self._chosen(None, None)
        q = values.shape[1]
        (theta, least, spread) = _gls(values, covariance, np.stack([np.ones(len(self)), x - x.mean()], 1), True)
        slopes, error = theta[q:], spread[q:, q:]
        explained = float(slopes @ np.linalg.solve(error, slopes))
        vectors = [_vector(self.modes, kind, slopes, error, free, self.frame) for kind in "TS"]
        return Trend(slopes, error, _test(explained, q), _test(least, (len(self) - 2) * q), *vectors)

    def drift(self, velocity):
        """The acceleration that, with the drift of a known velocity, fits the bins best.

        Parameters
        ----------
        velocity : Vector — ours, toward the apex, at the distances that `nearness` holds [km/s]

        Returns
        -------
        acceleration : Vector
        test : Test — of the bins about that prediction
        """
        from vsh.units import AU_PER_YEAR

        if not np.isfinite(self.nearness).all():
            raise ParameterError("a drift needs a distance in every bin, and some bin has none beyond the flow")
        values, covariance, free = self._chosen("S", 1)
        rows = FIRST_DEGREE @ -velocity.to_frame(self.frame).value / AU_PER_YEAR
        theta, least, spread = _gls(
            values - np.outer(self.nearness, rows), covariance, np.ones((len(self), 1)), with_errors=True
        )
        return _vector(self.modes, "S", theta, spread, free, self.frame), _test(least, 3 * (len(self) - 1))

    def to_table(self):
        """Spin and acceleration in each bin, with errors, as an astropy Table."""
        columns = {
            "z_low": self.edges[:-1], "z_high": self.edges[1:], "z": self.redshift, "sources": self.counts,
            "chi2_dof": np.array([s.reduced_chi2 for s in self.solutions]),
        }  # fmt: skip
        for name in ("spin", "acceleration"):
            vectors = [getattr(solution, name) for solution in self.solutions]
            for i, axis in enumerate("xyz"):
                columns[f"{name}_{axis}"] = np.array([v.value[i] for v in vectors])
                columns[f"{name}_{axis}_error"] = np.array([v.sigma[i] for v in vectors])
        units = {name: "uas / yr" for name in columns if name.startswith(("spin", "acceleration"))}
        return tables.table_of(columns, {"frame": self.frame, "notes": list(self.notes)}, units)

    def plot(self, velocity="planck"):
        """Components against redshift, with the drift of a velocity drawn in; a matplotlib figure."""
        from fit.plot_redshift import plot_bins

        return plot_bins(self, velocity)

    def _chosen(self, kind, l):
        """Values (B, q) of some of the free coefficients, their covariance and which they are."""
        modes = list(self.modes)
        keep = [
            i for i, k in enumerate(self.free) if kind in (None, modes[k].kind) and l in (None, modes[k].l)
        ]  # fmt: skip
        if not keep:
            raise ParameterError(f"no free coefficients of kind {kind} and degree {l} in the bins")
        free = self.free[keep]
        q, bins = len(self.free), len(self)
        index = (np.arange(bins)[:, None] * q + keep).ravel()
        values = np.stack([solution.coefficients.values[free] for solution in self.solutions])
        return values, self.covariance[np.ix_(index, index)], free


def binned(field, modes, edges, common=None, threads=None):
    """Fit the same modes in bins of redshift.

    Parameters
    ----------
    field : Field or iterable of Fields
        Sources without a usable redshift are left out; a note counts and names them.
    modes : Modes, or the degree lmax
    edges : (B + 1,) array, or int
        Rising; or the number of bins, of equal information. A bin holds z_low ≤ z < z_high.
    common : None or "higher"
        "higher" fits one set of coefficients above degree 1 to all bins.

    Returns
    -------
    BinnedSolution

    Raises
    ------
    ParameterError
        If the edges do not rise, or are too few.
    DegeneracyError
        If a bin is empty, or cannot tell the modes apart.
    FieldError
        If there are no redshifts.
    """
    modes = as_modes(modes)
    if common not in (None, "higher"):
        raise ParameterError(f'common is None or "higher", not {common!r}')
    fields = [field] if isinstance(field, Field) else field
    if np.ndim(edges) == 0:
        if not isinstance(field, Field):
            raise ParameterError("bins of equal information need the whole field: give their edges")
        edges = equal_information(field, edges)
    edges = np.asarray(edges, float)
    if edges.ndim != 1 or len(edges) < 2 or not (np.diff(edges) > 0).all():
        raise ParameterError(f"the edges of redshift bins must rise, not {edges.tolist()}")
    bins = len(edges) - 1
    normals, sums, notes, outside = [0] * bins, np.zeros((bins, 5)), [], 0
    for part in fields:
        good = with_redshift(part, 0.0)
        notes += [note for note in good.notes if note not in notes]
        place = np.searchsorted(edges, good.redshift, side="right") - 1
        outside += int(((place < 0) | (place >= bins)).sum())
        for b in np.unique(place[(place >= 0) & (place < bins)]):
            inside = good[place == b]
            normals[b] = normals[b] + normal_equations(inside, modes, threads=threads) if normals[b] else (
                normal_equations(inside, modes, threads=threads))  # fmt: skip
            sums[b] += _moments(inside)
    if outside:
        notes.append(f"left out {outside} sources with redshifts outside {edges[0]:g} … {edges[-1]:g}")
    for b, normal in enumerate(normals):
        if not normal:
            raise DegeneracyError(
                f"bin {b + 1} of {bins}, {edges[b]:g} ≤ z < {edges[b + 1]:g}, is empty: choose other edges"
            )
    counts = sums[:, 0].astype(int)
    solutions, covariance, free = (_apart if common is None or modes.lmax == 1 else _joint)(normals, edges)
    with np.errstate(invalid="ignore", divide="ignore"):
        nearness = sums[:, 3] / sums[:, 4]
    return BinnedSolution(
        edges, solutions, normals, sums[:, 2] / sums[:, 1], counts, covariance, free, nearness, tuple(notes)
    )


def equal_information(field, bins):
    """Edges of redshift bins that hold the same weight of motions, (bins + 1,)."""
    bins = int(bins)
    if bins < 1:
        raise ParameterError(f"{bins} bins are none")
    field = with_redshift(field, 0.0)
    if len(field) < bins:
        raise DegeneracyError(f"{len(field)} sources do not fill {bins} bins")
    order = np.argsort(field.redshift, kind="stable")
    z, weight = field.redshift[order], np.cumsum(field.weights[:2].sum(0)[order])
    inner = z[np.searchsorted(weight, weight[-1] * np.arange(1, bins) / bins)]
    return np.r_[z[0], inner, np.nextafter(z[-1], np.inf)]


def _moments(field):
    """Sources, Σw, Σwz, and beyond the flow Σw/d and Σw."""
    weight, z = field.weights[:2].sum(0) / 2, field.redshift
    far = z >= FLOW_LIMIT
    near = 0.0
    if far.any():
        from vsh.cosmology import transverse_distance

        near = weight[far] @ (1 / transverse_distance(z[far]))
    return np.array([len(field), weight.sum(), weight @ z, near, weight[far].sum()])


def _apart(normals, edges):
    """Each bin for itself."""
    solutions = []
    for b, normal in enumerate(normals):
        try:
            solutions.append(solve(normal))
        except DegeneracyError as error:
            raise DegeneracyError(_of_bin(b, edges, error)) from None
    p, bins = len(normals[0].modes), len(normals)
    covariance = np.zeros((bins, p, bins, p))
    for b, solution in enumerate(solutions):
        covariance[b, :, b] = solution.covariance
    return solutions, covariance.reshape(bins * p, bins * p), np.arange(p)


def _joint(normals, edges):
    """Degree 1 in each bin, the rest in common: one system of normal equations."""
    modes, bins = normals[0].modes, len(normals)
    own = np.array([i for i, mode in enumerate(modes) if mode.l == 1])
    rest = np.array([i for i, mode in enumerate(modes) if mode.l > 1])
    for b, normal in enumerate(normals):  # a bin that cannot bear its own degree 1 is told by name
        one = NormalEquations(as_modes(1), normal.matrix[np.ix_(own, own)], normal.rhs[own], 0.0, normal.n_data)
        try:
            solve(one)
        except DegeneracyError as error:
            raise DegeneracyError(_of_bin(b, edges, error)) from None
    size, shared = 6 * bins + len(rest), slice(6 * bins, None)
    matrix, rhs = np.zeros((size, size)), np.zeros(size)
    for b, normal in enumerate(normals):
        mine = slice(6 * b, 6 * b + 6)
        matrix[mine, mine], rhs[mine] = normal.matrix[np.ix_(own, own)], normal.rhs[own]
        matrix[mine, shared] = normal.matrix[np.ix_(own, rest)]
        matrix[shared, mine] = matrix[mine, shared].T
        matrix[shared, shared] += normal.matrix[np.ix_(rest, rest)]
        rhs[shared] += normal.rhs[rest]
    scale = 1 / np.sqrt(np.diag(matrix))
    scaled = matrix * np.outer(scale, scale)
    if np.linalg.eigvalsh(scaled)[0] < 1e-10:
        raise DegeneracyError(f"the bins together cannot separate {len(rest)} common and {6 * bins} free coefficients")
    covariance = np.linalg.inv(scaled) * np.outer(scale, scale)
    theta = covariance @ rhs
    solutions = []
    for b, normal in enumerate(normals):
        index = np.empty(len(modes), int)
        index[own], index[rest] = np.arange(6 * b, 6 * b + 6), np.arange(6 * bins, size)
        values = theta[index]
        chi2 = float(normal.chi2_zero - 2 * values @ normal.rhs + values @ normal.matrix @ values)
        solutions.append(
            Solution(Coefficients(modes, values), covariance[np.ix_(index, index)], chi2, normal.n_data,
                     normal.frame, normal.notes, "the catalogue, all bins together")
        )  # fmt: skip
    return solutions, covariance[: 6 * bins, : 6 * bins], own


def _of_bin(b, edges, error):
    return f"bin {b + 1}, {edges[b]:g} ≤ z < {edges[b + 1]:g}: {error}; or take fewer bins"


def _gls(values, covariance, design, with_errors=False):
    """Least squares of values (B, q) = design (B, k) · θ (k, q): θ, χ² and, if asked, θ's covariance."""
    q = values.shape[1]
    full = np.kron(design, np.eye(q))
    y = values.ravel()
    weighted = np.linalg.solve(covariance, np.column_stack([full, y]))
    spread = np.linalg.inv(full.T @ weighted[:, :-1])
    theta = spread @ (full.T @ weighted[:, -1])
    least = float(y @ weighted[:, -1] - theta @ (full.T @ weighted[:, -1]))
    return (theta, least, spread) if with_errors else (theta, least)


def _test(chi2, dof):
    return Test(chi2, dof, float(chdtrc(dof, chi2)) if dof else float("nan"))


def _vector(modes, kind, values, covariance, free, frame):
    """A vector from those of the values that belong to degree 1 of a kind."""
    wanted = np.arange(len(modes))[modes.degree(kind, 1)]
    at = [int(np.flatnonzero(free == k)[0]) for k in wanted]
    inverse = np.linalg.inv(FIRST_DEGREE)
    return Vector(inverse @ values[at], inverse @ covariance[np.ix_(at, at)] @ inverse.T, frame)
