"""The search for waves of frequencies within the mission, in positions along scan."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.in_time import TimeEquations, normal_equations, waves
from fit.quality import SEEN, hint_of, printed_p_value
from fit.storage import Result
from fit.waves._map import Whitened, chances, map_of, p_in_words, share_beyond
from fit.waves._search import WaveSearch
from vsh.io import tables
from vsh.length import length_limits
from vsh.modes import as_modes
from vsh.sky.pixels import centres
from vsh.tools import arguments
from vsh.tools.arguments import explained
from vsh.tools.errors import DegeneracyError, NothingLeftError, ParameterError
from vsh.tools.notes import merge_notes, note_lines
from vsh.tools.types import Axes, FloatArray, Rng, Table
from vsh.tools.units import UAS

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

#: How many frequencies a short report lists.
_LISTED = 8


@dataclass(frozen=True, eq=False, repr=False)
class WaveSpectrum(Result):
    """Searches for one wave at many frequencies.

    Attributes
    ----------
    frequencies : (n,) array
        [1/yr]
    statistic : (n,) array
        The largest 2F over all directions.
    lon, lat : (n,) arrays
        Where the best wave of each frequency travels to. [rad]
    amplitudes : (n,) array
        Its amplitude; noise makes it too large. [µas]
    limits : (n, 3) array
        Smallest, median and largest 95 % limit over the directions. [µas]
    p_values : (n,) array
        p-values of each frequency alone.
    p_value : float
        Probability that noise alone gives as large a 2F anywhere on the sky at any of these frequencies.
    lost : (n,) int array
        How many combinations of coefficients sources' own parameters take: at 1/yr parallaxes do.
    n_skies : int
    n_data : int
    degrees : tuple of int
    frame : str
    notes : tuple of str
    """

    frequencies: FloatArray
    statistic: FloatArray
    lon: FloatArray
    lat: FloatArray
    amplitudes: FloatArray
    limits: FloatArray
    p_values: FloatArray
    p_value: float
    lost: FloatArray
    n_skies: int
    n_data: int
    degrees: tuple[int, ...]
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<WaveSpectrum: {len(self.frequencies)} frequencies, p = {printed_p_value(self.p_value)}>"

    @property
    def strain_limits(self) -> FloatArray:
        """`limits` as strains, (n, 3)."""
        return self.limits * UAS

    @property
    def answer(self) -> tuple[tuple[str, str], ...]:
        """The lines to quote: whether a wave is detected, and how strong one can be."""
        best = int(np.argmax(self.statistic))
        p = p_in_words(self.p_value, self.n_skies)
        found = "detected" if self.p_value < SEEN else "not detected"
        words = f"{found} at {len(self.frequencies)} frequencies, p = {p} of all of them together"
        if self.p_value < SEEN:
            words += f"; the largest at {self.frequencies[best]:.4g} per year"
        elif hint := hint_of(self.p_value):
            words += f" ({hint})"
        medians = self.strain_limits[:, 1]
        low, high = (f"{value:.2g}" for value in (medians.min(), medians.max()))
        return (("wave", words), ("strain", f"< {low} to {high} (95 %, median of directions, by frequency)"))

    def report(self, *, long: bool = False) -> str:
        """Limits by frequency as text, and how likely noise alone is.

        Parameters
        ----------
        long : bool
            All frequencies; otherwise those with the smallest p-values.
        """
        best = int(np.argmax(self.statistic))
        lines = [
            f"One gravitational wave at {len(self.frequencies)} frequencies, degrees {self.degrees[0]} to "
            f"{self.degrees[-1]} of {self.n_data} numbers",
            f"largest 2F       {self.statistic[best]:.2f} at {self.frequencies[best]:.4g} a year, towards α = "
            f"{np.degrees(self.lon[best]) % 360:.1f}°, δ = {np.degrees(self.lat[best]):.1f}°",
            f"p-value          {p_in_words(self.p_value, self.n_skies)} "
            f"with all directions and frequencies looked at ({self.n_skies} simulated skies)",
            f"{'1/yr':>8}{'2F':>8}{'p alone':>10}{'95 % limit [µas] by direction':>32}{'strain, median':>16}",
        ]
        smallest = np.sort(np.argsort(self.p_values, kind="stable")[:_LISTED])
        for i in range(len(self.frequencies)) if long else smallest:
            f, statistic, p, limit = self.frequencies[i], self.statistic[i], float(self.p_values[i]), self.limits[i]
            spread = f"{limit[1]:.3g} ({limit[0]:.3g} … {limit[2]:.3g})"
            lines.append(f"{f:>8.4g}{statistic:>8.2f}{printed_p_value(p):>10}{spread:>32}{limit[1] * UAS:>16.2e}")
        if not long and len(self.frequencies) > _LISTED:
            lines.append(f"the {_LISTED} of {len(self.frequencies)} frequencies with the smallest p-values")
        return "\n".join([*lines, *note_lines(self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each frequency, as an astropy Table."""
        columns = {"frequency": self.frequencies, "statistic": self.statistic, "p_value": self.p_values}
        columns |= {"lon": np.degrees(self.lon) % 360, "lat": np.degrees(self.lat), "amplitude": self.amplitudes}
        columns |= {f"limit_{name}": each for name, each in zip(("low", "median", "high"), self.limits.T, strict=True)}
        columns["lost"] = self.lost
        return tables.table_of(columns, self._plain_facts(), {"lon": "deg", "lat": "deg", "frequency": "1 / yr"})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Limits on the strain against frequency, on matplotlib axes."""
        from fit.waves._plot import plot_spectrum

        return plot_spectrum(self, ax=ax)


@arguments.accepts(nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
@explained
def search_in_time(
    observations: Any,
    frequency: float | Sequence[float],
    *,
    attitude: Any = None,
    lmax: int = 5,
    nside: int = 8,
    n_skies: int = 1000,
    rng: Rng = 1,
    threads: int | None = None,
) -> Any:
    """Look for one gravitational wave of a frequency within the mission, in positions along scan.

    Each source keeps five parameters of its own, and the frame a rotation and a glide that swing at the frequency; what
    is left is compared with a wave from every direction, its two polarisations with cosine and sine of time.

    Parameters
    ----------
    observations : Observations, path, or an iterable of them
        Observations as `vsh.io.epochs.read_observations` gives them; as for `fit.in_time.normal_equations`.
    frequency : float or sequence of float
        Frequency of the wave, or several that are looked at. Below about one cycle in the time that they span,
        positions and motions of the sources take all of it. [1/yr]
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
    threads : int, optional
        One a core unless given.

    Returns
    -------
    WaveSearch or WaveSpectrum
        Amplitudes of the strain: plus and cross of cosine, then of sine [µas; 1 µas is a strain of 4.8e-12]. Of several
        frequencies a spectrum of limits, with one p-value for all of them.

    Raises
    ------
    DegeneracyError
        If the observations determine no wave of this frequency.
    ParameterError
        If they are no observations, a frequency is not above zero, or nothing is said of the attitude.

    Notes
    -----
    The response is that of a wave much shorter than the distances of the sources (Book & Flanagan 2011), and much
    longer than the time from one field of view to the other. 2F of noise is χ² with four degrees of freedom in one
    direction. The p-value is of all directions, and of several frequencies as if noise at each were independent, which
    is true where they are 1/T apart and on the safe side where they are closer.

    An attitude that was solved from the same sky, as in Gaia's releases, takes a part of the wave up: as if it were
    known .59 to .68 of the amplitude of waves put into such a solution is found, and the "95 %" limit is .7 of the true
    one; with a Response of nside 8 it is .96, of nside 16 .98.
    """
    several = np.ndim(frequency) > 0
    frequencies = [arguments.positive("frequency", each) for each in np.atleast_1d(frequency)]
    modes = as_modes(lmax)
    if modes.lmax < 2:
        raise ParameterError("waves have degrees from 2 on: lmax of 2 or more")
    rng = arguments.generator(rng)
    searches, largest, lost = [], [], []
    for each in frequencies:
        try:
            equations = normal_equations(observations, modes, waves(each), attitude=attitude, threads=threads)
        except NothingLeftError as error:
            raise DegeneracyError(str(error)) from None
        one, maxima, missing = _search(equations, each, nside, n_skies, rng)
        searches.append(one)
        largest.append(maxima)
        lost.append(missing)
    if not several:
        return searches[0]
    best = np.array([np.argmax(each.statistic) for each in searches])
    top = np.array([each.statistic.max() for each in searches])
    lon, lat = centres(nside)
    return WaveSpectrum(
        np.array(frequencies),
        top,
        lon[best],
        lat[best],
        np.array([each.amplitude for each in searches]),
        np.array([np.quantile(each.limits, [0, 0.5, 1]) for each in searches]),
        np.array([each.p_value for each in searches]),
        share_beyond(np.max(largest, axis=0), top.max()),
        np.array(lost),
        n_skies,
        searches[0].n_data,
        searches[0].degrees,
        notes=merge_notes(*(each.notes for each in searches)),
    )


def _search(equations: TimeEquations, frequency, nside, n_skies, rng):
    """One frequency: the search, the largest 2F of each sky of noise, and how many combinations are lost."""
    modes, unseen = equations.modes, equations.unseen
    free, values, directions, kept = equations.combinations()
    if values[-1] <= 0 or kept.sum() < len(free) / 2:
        raise DegeneracyError(
            f"these sources do not determine {len(free)} coefficients: lower lmax, or take more of the sky"
        )
    size = np.diag(equations.matrix)
    # A rotation is attitude: any prior does.
    matrix = equations.matrix + np.diag(np.where(unseen, np.median(size), 1e-9 * size))
    white = Whitened.of(matrix, equations.rhs, np.tile(modes.degrees >= 2, 2))
    statistic, amplitudes, covariance = map_of(white, modes, nside, copies=2)
    maxima = chances(white, modes, nside, n_skies, rng, copies=2)
    notes = (*equations.notes, SOLVED_ATTITUDE if equations.attitude != "known" else KNOWN_ATTITUDE)
    lost = np.flatnonzero(~kept)
    if len(lost):
        shown = "; ".join(equations.named(free, directions[:, i], 2) for i in lost[:3])
        notes = (
            *notes,
            f"at {frequency:.4g} a year {len(lost)} of {len(free)} combinations are taken by the sources' own "
            f"parallaxes, positions and motions: {shown}{'; …' if len(lost) > 3 else ''}",
        )
    search = WaveSearch(
        statistic,
        amplitudes,
        length_limits(amplitudes.T, covariance),
        share_beyond(maxima, statistic.max()),
        n_skies,
        tuple(range(2, modes.lmax + 1)),
        "icrs",
        equations.n_data,
        float(frequency),
        "µas",
        notes,
    )
    return search, maxima, len(lost)
