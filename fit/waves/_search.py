"""The search for one wave in the coefficients of motions."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fit.background import equations_of
from fit.normal import NormalEquations
from fit.quality import printed_p_value
from fit.solution import HarmonicSolution
from fit.storage import Result
from fit.waves._map import Whitened, chance, map_of, p_in_words
from vsh.io import tables
from vsh.length import length_limits
from vsh.models.waves import strain_of
from vsh.sky.frames import ANGLES, check_frame
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import explained
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.notes import note_lines
from vsh.tools.types import AxesArray, FloatArray, OnAxes, Rng, Table
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
            f"p-value          {p_in_words(self.p_value, self.n_skies)} that noise alone gives as much anywhere "
            f"({self.n_skies} simulated skies)",
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

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Maps of 2F and of the limits, on matplotlib axes."""
        from fit.waves._plot import plot_search

        return plot_search(self, ax=ax)


@arguments.accepts(nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
@explained
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
        length_limits(amplitudes.T, covariance),
        1.0,
        n_skies,
        wanted,
        equations.frame or "icrs",
        equations.n_data,
        notes=equations.notes,
    )
    return replace(search, p_value=chance(white, modes, nside, statistic.max(), n_skies, rng))
