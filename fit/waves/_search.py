"""The search for one wave in the coefficients of motions."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.background import equations_of
from fit.normal import NormalEquations
from fit.quality import printed_p_value, vector_limit
from fit.solution import HarmonicSolution
from fit.storage import Result
from fit.waves._map import Whitened, chance, map_of
from vsh.basis import harmonics
from vsh.io import tables
from vsh.io.epochs import Observations
from vsh.models.waves import strain_of
from vsh.modes import as_modes
from vsh.sky.frames import ANGLES, check_frame
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError
from vsh.tools.notes import note_lines
from vsh.tools.types import FloatArray, Rng, Table
from vsh.tools.units import UAS
from vsh.vector import Vector


@dataclass(frozen=True, eq=False, repr=False)
class WaveSearch(Result):
    """Every direction that one wave may travel to.

    Attributes
    ----------
    statistic : (12 nside²,) array
        2F of each direction, in ring order: by how much χ² falls with the best wave; from noise alone a χ².
    amplitudes : (k, 12 nside²) array
        The best plus and cross (of cosine, then of sine, where the search is in time). [`unit`]
    limits : (12 nside²,) array
        How strong a wave of each direction can be, with 95 %. [`unit`]
    p_value : float
        Probability that noise alone gives as large a 2F somewhere on the sky, from `n_skies` simulated ones.
    n_skies : int
    degrees : tuple of int
        Which were used.
    frame : str
        Frame of the axes.
    n_data : int
        How many numbers were fitted.
    frequency : float or None
        Frequency of a search in time. [1/yr]
    unit : str
        "µas/yr" of a rate of strain; "µas" of a strain, in time.
    notes : tuple of str
    """

    statistic: FloatArray
    amplitudes: FloatArray
    limits: FloatArray
    p_value: float
    n_skies: int
    degrees: tuple[int, ...]
    frame: str
    n_data: int
    frequency: float | None = None
    unit: str = "µas/yr"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        check_frame(self.frame)
        if self.amplitudes.shape[1:] != self.statistic.shape or self.limits.shape != self.statistic.shape:
            raise ParameterError("the maps of a search are of one size")
        super().__post_init__()

    def __repr__(self) -> str:
        return f"<WaveSearch: largest 2F {self.statistic.max():.3g}, p = {printed_p_value(self.p_value)}>"

    @property
    def nside(self) -> int:
        """Resolution of the map."""
        return round(np.sqrt(len(self.statistic) / 12))

    @property
    def direction(self) -> tuple[float, float]:
        """Where the best wave travels to: longitude and latitude. [deg]"""
        lon, lat = (float(np.degrees(each[np.argmax(self.statistic)])) for each in centres(self.nside))
        return lon % 360, lat

    @property
    def vector(self) -> FloatArray:
        """The same as a unit vector k, (3,)."""
        return triad(*np.radians(self.direction))[2]

    @property
    def amplitude(self) -> float:
        """The amplitude of the best wave, the root of the sum of squares; noise makes it too large. [`unit`]"""
        return float(np.linalg.norm(self.amplitudes[:, np.argmax(self.statistic)]))

    def strain(self, frequency: float | None = None) -> float:
        """The strain of the best wave.

        Parameters
        ----------
        frequency : float, optional
            Frequency of a wave longer than the observations, whose rate alone is seen. [nHz]

        Raises
        ------
        ParameterError
            If no frequency is given, and none is known.
        """
        return float(self._strains(np.array(self.amplitude), frequency))

    def strain_limits(self, frequency: float | None = None) -> FloatArray:
        """The strain that a wave of each direction can have, with 95 %, (12 nside²,), at a `frequency` as for `strain`.

        Raises
        ------
        ParameterError
            If no frequency is given, and none is known.
        """
        return self._strains(self.limits, frequency)

    def _strains(self, values, frequency):
        if self.unit == "µas":
            return values * UAS
        if frequency is None:
            raise ParameterError("the rate of a strain is seen: a frequency [nHz] makes it a strain, strain(frequency)")
        return strain_of(values, frequency)

    def report(self) -> str:
        """What was found, as text."""
        lon, lat = self.direction
        there = Vector.from_spherical(1.0, lon, lat, frame=self.frame)
        lines = [
            f"One gravitational wave, in degrees {self.degrees[0]} to {self.degrees[-1]} of {self.n_data} numbers"
            + (f", at {self.frequency:.4g} a year" if self.frequency else ", longer than the observations"),
            (
                f"largest 2F       {self.statistic.max():.2f} of {len(self.statistic)} directions; χ² of "
                f"{len(self.amplitudes)} each from noise alone"
            ),
            (
                "p-value         "
                f" {'at most ' * (self.p_value * (1 + self.n_skies) < 1.5)}{printed_p_value(self.p_value)} that noise "
                f"alone gives as much anywhere ({self.n_skies} simulated skies)"
            ),
        ]
        for frame in dict.fromkeys((self.frame, "galactic")):
            place = there.to_frame(frame).direction
            place_text = ", ".join(f"{name} = {value:.1f}°" for name, value in zip(ANGLES[frame], place, strict=True))
            lines.append(f"travels to       {place_text}" if frame == self.frame else f"                 {place_text}")
        best = self.amplitudes[:, np.argmax(self.statistic)]
        kinds = ("plus", "cross") if len(best) == 2 else ("plus cos", "cross cos", "plus sin", "cross sin")
        lines.append(
            "best wave        "
            + ", ".join(f"{kind} {value:+.4g}" for kind, value in zip(kinds, best, strict=True))
            + f" {self.unit}"
        )
        low, middle, high = np.quantile(self.limits, [0, 0.5, 1])
        lines.append(f"95 % limits      {low:.4g} … {high:.4g} {self.unit} by direction, median {middle:.4g}")
        if self.unit == "µas":
            lines.append(f"                 a strain of {float(self._strains(np.array(middle), None)):.3g}")
        else:
            lines.append(f"                 a strain of {strain_of(middle, 1.0):.3g} (1 nHz/f)")
        return "\n".join([*lines, *note_lines(self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each direction, as an astropy Table."""
        lon, lat = centres(self.nside)
        columns = {
            "lon": np.degrees(lon) % 360,
            "lat": np.degrees(lat),
            "statistic": self.statistic,
            "limit": self.limits,
        }
        columns |= {f"amplitude_{i}": each for i, each in enumerate(self.amplitudes)}
        return tables.table_of(columns, self._plain_facts() | {"ORDERING": "RING"}, {"lon": "deg", "lat": "deg"})

    def plot(self, *, ax: Any = None) -> Any:
        """Maps of 2F and of the limits, on matplotlib axes."""
        from fit.waves._map import plot_search

        return plot_search(self, ax=ax)


@arguments.accepts(nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
def search(
    normal: NormalEquations | HarmonicSolution,
    *,
    degrees: Iterable[int] | None = None,
    nside: int = 16,
    n_skies: int = 1000,
    rng: Rng = 1,
) -> WaveSearch:
    """Look for one plane gravitational wave, much longer than the observations, in every direction.

    Parameters
    ----------
    normal : NormalEquations or Solution
        What was summed or fitted, to degree 2 at least. Errors are taken as they are there: give a robust solution, or
        `solution.scaled`, where the residuals contradict the catalogue's. Degree 1 is fitted freely.
    degrees : iterable of int, optional
        Where waves are looked for; all from 2 on unless given. Fitted ones that are not named are left free.
    nside : int
        Resolution of the HEALPix map of directions; 16 has 3072.
    n_skies : int
        Simulated skies of noise, for the p-value.
    rng : Generator or int
        The source of their noise.

    Raises
    ------
    ModesError
        If degree 1 is named, or one that is not fitted.
    DegeneracyError
        If the data do not determine the coefficients.

    Notes
    -----
    2F = gᵀF⁻¹g of the coefficients, with all others free: the F-statistic of pulsar timing (Babak & Sesana 2012, PRD
    85, 044034). Of noise alone χ² with two degrees of freedom in any one direction. A wave at the limit of what is seen
    is found within some 30° of its direction or its opposite's ring: low degrees resolve no more. Errors that sources
    share pass for waves, as any field of low degree does: see what `fit.background.floor` says first.
    """
    equations = equations_of(normal)
    modes = equations.modes
    wanted = tuple(sorted(set(degrees))) if degrees is not None else tuple(range(2, modes.lmax + 1))
    if not wanted or wanted[0] < 2 or wanted[-1] > modes.lmax:
        raise ModesError(f"waves have degrees from 2 on, and {modes.lmax} are fitted: not {wanted or 'none'}")
    white = Whitened.of(equations.matrix, equations.rhs, np.isin(modes.degrees, wanted))
    statistic, amplitudes, covariance = map_of(white, modes, nside)
    search = WaveSearch(
        statistic,
        amplitudes,
        vector_limit(amplitudes.T, covariance, 2),
        1.0,
        n_skies,
        wanted,
        equations.frame or "icrs",
        equations.n_data,
        notes=equations.notes,
    )
    return replace(search, p_value=chance(white, modes, nside, statistic.max(), n_skies, rng))


#: Notes of searches in time: of an attitude that is known, and of one that was solved.
KNOWN_ATTITUDE = (
    "warning: amplitudes and limits are those of an attitude that is known from elsewhere; where it was solved from the"
    " same sky, as in Gaia's releases, 0.6 to 0.7 of a wave is left, and a 95 % limit is 0.7 of the truth: give a "
    "sim.agis.Response"
)
SOLVED_ATTITUDE = (
    "of each wave is taken what an attitude solved from the same sky took of it; a rotation that changes with "
    "time is not seen"
)


@arguments.accepts(frequency=arguments.positive, nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
def search_in_time(
    observations: Observations,
    frequency: float,
    *,
    attitude: Any = None,
    lmax: int = 5,
    nside: int = 8,
    n_skies: int = 1000,
    rng: Rng = 1,
) -> WaveSearch:
    """Look for one gravitational wave of a frequency within the mission, in positions along scan.

    Each source keeps five parameters of its own, and the frame a rotation and a glide that swing at the frequency; what
    is left is compared with a wave from every direction, its two polarisations with cosine and sine of time.

    Parameters
    ----------
    observations : Observations
        Observations as `vsh.io.epochs.read_observations` gives them.
    frequency : float
        Frequency of the wave. Below about one cycle in the time that they span, positions and motions of the sources
        take all of it. [1/yr]
    attitude : sim.agis.Response, or "known"
        What the attitude takes of a wave where it was solved from the same sky, as in Gaia's releases; or that it is
        known from elsewhere. There is no default.
    lmax : int
        The highest degree; a wave has 99 % of its power up to 5.
    nside : int
        Resolution of the HEALPix map of directions.
    n_skies : int
        Simulated skies of noise, for the p-value.
    rng : Generator or int
        The source of their noise.

    Returns
    -------
    WaveSearch
        Amplitudes of the strain: plus and cross of cosine, then of sine. [µas; 1 µas is a strain of 4.8e-12]

    Raises
    ------
    DegeneracyError
        If the observations determine no wave of this frequency.
    ParameterError
        If they are no Observations, the frequency is not above zero, or nothing is said of the attitude.

    Notes
    -----
    The response is that of a wave much shorter than the distances of the sources (Book & Flanagan 2011), and much
    longer than the time from one field of view to the other. 2F of noise is χ² with four degrees of freedom in one
    direction; the p-value is of all directions at this frequency: of several that are tried, it is to be multiplied by
    their number.

    An attitude that was solved from the same sky, as in Gaia's releases, takes a part of the wave up: as if it were
    known .59 to .68 of the amplitude of waves put into such a solution is found, and the "95 %" limit is .7 of the true
    one; with a Response of nside 8 it is .96, of nside 16 .98.
    """
    arguments.a(Observations)("observations", observations)
    modes = as_modes(lmax)
    if modes.lmax < 2:
        raise ParameterError("waves have degrees from 2 on: lmax of 2 or more")
    if attitude is None:
        raise ParameterError(
            "say what the attitude is: sim.agis.Response(law) where it was solved from the same sky, as in Gaia's "
            'releases, or attitude="known"'
        )
    rate = 2 * np.pi * frequency
    if isinstance(attitude, str):
        arguments.choice("attitude", attitude, ("known",))
        matrix, rhs, used = _known(observations, modes, rate)
    else:
        matrix, rhs, used = _responding(observations, modes, rate, attitude)
    if used == 0:
        raise DegeneracyError("no source has more observations than five parameters of its own: none tells of waves")
    white = Whitened.of(matrix, rhs, np.tile(modes.degrees >= 2, 2))
    statistic, amplitudes, covariance = map_of(white, modes, nside, copies=2)
    search = WaveSearch(
        statistic,
        amplitudes,
        vector_limit(amplitudes.T, covariance, 4),
        1.0,
        n_skies,
        tuple(range(2, modes.lmax + 1)),
        "icrs",
        used,
        float(frequency),
        "µas",
        (*observations.notes, KNOWN_ATTITUDE if isinstance(attitude, str) else SOLVED_ATTITUDE),
    )
    return replace(search, p_value=chance(white, modes, nside, statistic.max(), n_skies, rng, copies=2))


def _known(observations, modes, rate):
    """Normal equations of cosine and sine times every mode, nothing taken by the attitude."""
    p, used = len(modes), 0
    matrix, rhs = np.zeros((2 * p, 2 * p)), np.zeros(2 * p)
    for rows, form, side, count in _sources(observations, rate):
        basis = harmonics(observations.lon[rows], observations.lat[rows], modes)
        # (cosine, sine) × (east, north) of each source, and of each coefficient.
        flat = basis.reshape(p, -1)
        blocks = [
            [flat @ np.einsum("nij,pjn->pin", form[:, a : a + 2, b : b + 2], basis).reshape(p, -1).T for b in (0, 2)]
            for a in (0, 2)
        ]
        matrix += np.block(blocks)
        rhs += np.concatenate([flat @ side[:, a : a + 2].T.ravel() for a in (0, 2)])
        used += count
    return matrix, rhs, used


def _responding(observations, modes, rate, attitude, size=300):
    """The same, of what the attitude leaves; five parameters of every source eliminated, a rotation held fixed."""
    n, p, used = len(observations.lon), len(modes), 0
    bounds = np.searchsorted(observations.source, np.arange(n + 1))
    total: Any = np.zeros((2 * p + 1, 2 * p + 1))

    def functions(time):
        return np.array([np.cos(rate * time), np.sin(rate * time)])

    for start in range(0, n, size):
        stop = min(start + size, n)
        own = slice(bounds[start], bounds[stop])
        source, design = observations.source[own], observations.design[:, own]
        if not len(source):
            continue
        seen = attitude.left(
            observations.lon[source], observations.lat[source], design[:2], observations.time[own], modes, functions
        )
        error = observations.error[own]
        columns = np.column_stack([seen, observations.position[own]]) / error[:, None]
        rows = design / error
        counts = np.bincount(source - start, minlength=stop - start)
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        for k in np.flatnonzero(counts > 5):
            mine = slice(first[k], first[k] + counts[k])
            five = rows[:, mine].T
            root, triangle = np.linalg.qr(five / np.linalg.norm(five, axis=0))
            if np.abs(np.diag(triangle)).min() < 1e-5:
                continue
            left = columns[mine] - root @ (root.T @ columns[mine])
            total += left.T @ left
            used += int(counts[k])
    matrix = np.array(total[:-1, :-1])
    degree, typical = np.tile(modes.degrees, 2), np.median(np.diag(matrix))
    unseen = (degree == 1) & (np.diag(matrix) < 1e-3 * typical)
    matrix[unseen, unseen] += typical  # a rotation in time is attitude: any prior does
    return matrix, total[:-1, -1], used


def _sources(
    observations: Observations, rate: float, size: int = 2000
) -> Iterator[tuple[Any, FloatArray, FloatArray, int]]:
    """Some sources at a time: which, the 4 × 4 forms and sides that their parameters leave, number of observations."""
    n = len(observations.lon)
    bounds = np.searchsorted(observations.source, np.arange(n + 1))
    for start in range(0, n, size):
        stop = min(start + size, n)
        own = slice(bounds[start], bounds[stop])
        design, time, scan = observations.design[:, own], observations.time[own], observations.design[:2, own]
        columns = np.concatenate(
            [design, scan * np.cos(rate * time), scan * np.sin(rate * time), observations.position[own][None]]
        )
        columns = columns / observations.error[own]
        source = observations.source[own] - start
        counts = np.bincount(source, minlength=stop - start)
        sums = np.array([[np.bincount(source, x * y, stop - start) for x in columns] for y in columns]).transpose(
            2, 0, 1
        )
        five = sums[:, :5, :5]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", five), 1e-300))
        enough = counts > 5
        with np.errstate(invalid="ignore"):
            enough &= np.linalg.cond(five / scale[:, :, None] / scale[:, None, :]) < 1e10
        if not enough.any():
            continue
        some = sums[enough]
        taken = some[:, :5, 5:].transpose(0, 2, 1) @ np.linalg.solve(some[:, :5, :5], some[:, :5, 5:])
        left = some[:, 5:, 5:] - taken
        yield start + np.flatnonzero(enough), left[:, :4, :4], left[:, :4, 4], int(counts[enough].sum())
