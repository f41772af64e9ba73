"""Normal equations of functions of time × modes, five parameters of every source eliminated.

A position along scan is w = S x + m·Σ c_kl f_k(t) Y_l + noise, S x the five parameters of its source. Where the
attitude was solved from the same sky, each template f_k Y_l is replaced by what the attitude left of it
(`sim.agis.Response`); with S eliminated source by source,

    N = B'ᵀ W B',   B' = (1 − P_S)(B − what the attitude took of B),

are the equations of the joint problem, and add over sources.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from fit.in_time._solution import Functions, TimeSolution
from vsh.basis import harmonics
from vsh.io.epochs import COLOUR_PRIOR, Observations, iterate_observations
from vsh.io.parts import add_sums
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, EmptyFieldError, ModesError, ParameterError, TableError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.printing import printable
from vsh.tools.types import BoolArray, FloatArray, IntArray

#: Sources taken together: some 50 MB of templates for 240 unknowns and 90 transits of each.
_SOURCES_PER_BLOCK = 250
#: Combinations with less information than this share of the most are taken by the sources' own parameters.
_LEAST_INFORMATION = 1e-3


@dataclass(frozen=True, eq=False)
class TimeEquations(Frozen):
    """N c = b of functions × modes, summed over sources. They add.

    Attributes
    ----------
    modes : Modes
        Harmonics on the sky.
    functions : Functions
        Functions of time.
    matrix : (F p, F p) array
        N, functions outermost. [1/µas²]
    rhs : (F p,) array
        b. [1/µas]
    chi2_null : float
        χ² with five parameters of each source and nothing else.
    n_data, n_sources : int
        Observations that were used, and of how many sources.
    attitude : str
        "known", or of which response templates are what is left.
    notes : tuple of str
    """

    modes: Modes
    functions: Functions
    matrix: FloatArray
    rhs: FloatArray
    chi2_null: float
    n_data: int
    n_sources: int
    attitude: str
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"<TimeEquations: {self.n_sources} sources, {len(self.functions)} functions × degree {self.modes.lmax}, "
            f"attitude {self.attitude}>"
        )

    def __add__(self, other: TimeEquations) -> TimeEquations:
        if not isinstance(other, TimeEquations):
            return NotImplemented
        for name in ("modes", "functions", "attitude"):
            if getattr(self, name) != getattr(other, name):
                raise ModesError(f"equations of different {name} do not add: sum all parts with the same")
        names = ("matrix", "rhs", "chi2_null", "n_data", "n_sources")
        sums: dict[str, Any] = {name: getattr(self, name) + getattr(other, name) for name in names}
        return replace(self, **sums, notes=merge_notes(self.notes, other.notes))

    def __radd__(self, other: Any) -> TimeEquations:
        return self if other == 0 else NotImplemented  # the start of sum()

    def combinations(self) -> tuple[IntArray, FloatArray, FloatArray, BoolArray]:
        """Combinations of the unknowns that the observations determine.

        Returns
        -------
        free : (k,) int array
            The unknowns that are seen.
        values, directions : (k,) and (k, k) arrays
            Eigenvalues of N with a unit diagonal, rising, and eigenvectors in columns.
        kept : (k,) bool array
            Which are determined; sources' own positions, parallaxes and motions take the others.
        """
        free = np.flatnonzero(~self.unconstrained_terms)
        matrix = self.matrix[np.ix_(free, free)]
        scale = np.sqrt(np.diag(matrix))
        eigenvalues, directions = np.linalg.eigh(matrix / np.outer(scale, scale))
        return free, eigenvalues, directions, (eigenvalues > 0) & (eigenvalues > _LEAST_INFORMATION * eigenvalues[-1])

    def named(self, free: IntArray, direction: FloatArray, most: int = 3) -> str:
        """A combination of the unknowns `free` in words, by the `most` largest coefficients of its `direction`."""
        names = [f"{function} {mode}" for function in self.functions.names for mode in self.modes]
        largest_indices = np.argsort(-np.abs(direction))[:most]
        return ", ".join(f"{direction[i]:+.2f} {names[free[i]]}" for i in largest_indices)

    @property
    def unconstrained_terms(self) -> BoolArray:
        """Mask of unknowns that nothing determines, (F p,): where the attitude was solved, a rotation in time."""
        information = np.diag(self.matrix)
        is_dipole = np.tile(self.modes.degrees == 1, len(self.functions))
        return (information <= 0) | (is_dipole & (information < 1e-3 * np.median(information)))


def normal_equations(
    observations: Any, lmax: int | Modes, functions: Functions, *, attitude: Any = None, threads: int | None = None
) -> TimeEquations:
    """Sum the normal equations of functions of time × harmonics over sources.

    Parameters
    ----------
    observations : Observations, path, or an iterable of them
        Epochs; of a folder every table, one after the other, so that no more than one is in memory. A source must stand
        in one of them only.
    lmax : int or Modes
        The highest degree.
    functions : Functions
        `waves`, or a sum of several.
    attitude : sim.agis.Response, or "known"
        What the attitude takes of a changing sky where it was solved from that sky, as in Gaia's releases; or that it
        is known from elsewhere. There is no default.
    threads : int, optional
        One a core unless given.

    Returns
    -------
    TimeEquations
        For `solve`.

    Raises
    ------
    ParameterError
        If nothing is said of the attitude, or these are no observations.
    TableError
        If a source stands in two parts.
    EmptyFieldError
        If no source has more observations than parameters of its own.

    Notes
    -----
    Some 2 ms of CPU a source of 90 transits at 240 unknowns, most of it a matrix product. Transits of one source should
    be means of their CCDs (`Observations.by_transit`), which are nine times fewer.
    """
    if attitude is None:
        raise ParameterError(
            "attitude= is missing: sim.agis.Response(law) where it was solved from the same sky, as in Gaia's "
            'releases, or attitude="known"'
        )
    if isinstance(attitude, str):
        arguments.choice("attitude", attitude, ("known",))
    arguments.a(Functions)("functions", functions)
    modes = as_modes(lmax)
    total: TimeEquations | None = None
    earlier_names: set[Any] = set()
    for part in _iterate_parts(observations):
        part_names = set(np.asarray(part.name).tolist())
        if twice := earlier_names & part_names:
            raise TableError(
                f"{len(twice)} sources stand in two parts ({printable(min(twice))}, …): the five parameters of a source"
                " need all of its observations together"
            )
        earlier_names |= part_names
        equations = _sum_part_equations(part, modes, functions, attitude, threads)
        total = equations if total is None else total + equations
    if total is None or total.n_sources == 0:
        raise EmptyFieldError("no source has more observations than five parameters of its own: none tells of time")
    return total


def _iterate_parts(observations: Any) -> Iterator[Observations]:
    """Iterate over the parts of the observations, each read when its turn comes."""
    if isinstance(observations, Observations):
        yield observations
    elif isinstance(observations, str | Path):
        yield from iterate_observations(observations)
    elif isinstance(observations, Iterable):
        for entry in observations:
            yield from _iterate_parts(entry)
    else:
        raise ParameterError(f"observations must be Observations or files of epochs, not {observations!r}")


def _sum_part_equations(observations, modes, functions, attitude, threads):
    """Sum the equations of one part of the observations."""
    n, n_unknowns = len(observations.lon), len(functions) * len(modes)
    bounds = np.searchsorted(observations.source, np.arange(n + 1))
    has_response = not isinstance(attitude, str)
    if has_response:
        attitude.taken(modes, functions)  # once, before threads ask for it

    def sum_products(selection):
        return _sum_block_products(
            observations, bounds, selection.start, selection.stop, modes, functions, attitude if has_response else None
        )

    zero: Any = np.zeros((n_unknowns + 1, n_unknowns + 1)), 0, 0
    matrix, n_data, n_sources = reduce(add_sums, map_blocks(sum_products, n, _SOURCES_PER_BLOCK, threads), zero)
    n_unused = n - n_sources
    notes = observations.notes + (tuple(getattr(attitude, "notes", ())) if has_response else ())
    if n_unused:
        notes = (*notes, f"{n_unused} of {n} sources have too few observations, or all in one direction: not used")
    return TimeEquations(
        modes,
        functions,
        np.array(matrix[:-1, :-1]),
        np.array(matrix[:-1, -1]),
        float(matrix[-1, -1]),
        n_data,
        n_sources,
        repr(attitude) if has_response else "known",
        notes,
    )


def _sum_block_products(observations, transit_bounds, start, stop, modes, functions, attitude):
    """Sum products of the templates and positions of some sources, their five parameters taken out."""
    transits = slice(transit_bounds[start], transit_bounds[stop])
    n_columns = len(functions) * len(modes) + 1
    source, design, time = observations.source[transits], observations.design[:, transits], observations.time[transits]
    if not len(source):
        return np.zeros((n_columns, n_columns)), 0, 0
    lon, lat, scan = observations.lon[source], observations.lat[source], design[:2]
    columns = np.empty((len(source), n_columns))
    if attitude is None:
        fields = harmonics(observations.lon[start:stop], observations.lat[start:stop], modes)[:, :, source - start]
        along_scan = fields[:, 0] * scan[0] + fields[:, 1] * scan[1]
        columns[:, :-1] = np.einsum("fk,pk->kfp", functions(time), along_scan).reshape(len(time), -1)
    else:
        view = None if observations.view is None else observations.view[transits]
        columns[:, :-1] = attitude.left(lon, lat, scan, time, modes, functions, view=view)
    columns[:, -1] = observations.position[transits]
    columns /= observations.error[transits][:, None]
    own_columns = (design / observations.error[transits]).T
    prior_row = np.zeros((0, 5))
    if observations.colour is not None:  # a pseudocolour, and its prior as one more observation of each source
        own_columns = np.column_stack([own_columns, -observations.colour[transits] / observations.error[transits]])
        prior_row = np.array([[0, 0, 0, 0, 0, 1 / COLOUR_PRIOR]])
    prior_columns = np.zeros((stop - start, n_columns))
    transit_counts = np.bincount(source - start, minlength=stop - start)
    row_starts = np.concatenate([[0], np.cumsum(transit_counts)])
    n_data = n_sources = 0
    for k in range(stop - start):
        source_rows = slice(row_starts[k], row_starts[k + 1])
        if transit_counts[k] > own_columns.shape[1]:
            stacked = np.vstack([own_columns[source_rows], prior_row])
            orthogonal, triangular = np.linalg.qr(stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-300))
            if np.abs(np.diag(triangular)).min() > 1e-5:
                fitted = orthogonal @ (orthogonal[: transit_counts[k]].T @ columns[source_rows])
                columns[source_rows] -= fitted[: transit_counts[k]]
                prior_columns[k] = fitted[transit_counts[k] :].sum(0)
                n_data, n_sources = n_data + int(transit_counts[k]), n_sources + 1
                continue
        columns[source_rows] = 0.0
    return columns.T @ columns + prior_columns.T @ prior_columns, n_data, n_sources


def solve(equations: TimeEquations) -> TimeSolution:
    """Solve for the coefficients of every function.

    Parameters
    ----------
    equations : TimeEquations
        What `normal_equations` summed.

    Returns
    -------
    TimeSolution
        Errors are those of the observations. A rotation that changes with time is not among the unknowns where the
        attitude was solved; combinations that parallaxes or motions of the sources take are named, and held at zero.

    Raises
    ------
    DegeneracyError
        If the observations determine less than half of the combinations.
    """
    arguments.a(TimeEquations)("equations", equations)
    modes, functions = equations.modes, equations.functions
    free, eigenvalues, directions, is_determined = equations.combinations()
    scale = np.sqrt(np.diag(equations.matrix)[free])
    if is_determined.sum() < len(free) / 2:
        raise DegeneracyError(
            f"{equations.n_sources} sources determine {is_determined.sum()} of {len(free)} combinations of these "
            "functions: take fewer functions, a lower degree, or more sources"
        )
    covariance_root = directions[:, is_determined] / np.sqrt(eigenvalues[is_determined]) / scale[:, None]
    n_unknowns = len(functions) * len(modes)
    coefficients, covariance = np.zeros(n_unknowns), np.zeros((n_unknowns, n_unknowns))
    coefficients[free] = covariance_root @ (covariance_root.T @ equations.rhs[free])
    covariance[np.ix_(free, free)] = covariance_root @ covariance_root.T
    seen_shares = np.zeros(n_unknowns)
    seen_shares[free] = np.sum(directions[:, is_determined] ** 2, 1)
    held_names = tuple(equations.named(free, directions[:, i]) for i in np.flatnonzero(~is_determined))
    return TimeSolution(
        modes=modes,
        functions=functions,
        values=coefficients.reshape(len(functions), -1),
        covariance=covariance,
        chi2=float(equations.chi2_null - equations.rhs @ coefficients),
        dof=equations.n_data - 5 * equations.n_sources - int(is_determined.sum()),
        n_sources=equations.n_sources,
        attitude=equations.attitude,
        seen=seen_shares.reshape(len(functions), -1),
        lost=held_names,
        notes=equations.notes,
    )
