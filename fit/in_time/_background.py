"""Stochastic backgrounds by bands of frequency: posterior of each, evidence, limits.

Coefficients of a band's functions are c ~ N(0, P_b D), D the shares of degrees and kinds, beside noise of covariance
N⁻¹; degree 1 is free: `fit.background.Amplitudes` has the likelihood.

√P_b is flat a priori. Draws come from the product of what each band says with all others free, weighted by L.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fit.background import Amplitudes, trapezoids
from fit.in_time._equations import TimeEquations
from fit.normal import eliminate
from fit.results.quality import Quality
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.models.covariance import Spectrum, wave_fractions
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError
from vsh.tools.types import Axes, FloatArray, Rng, Table
from vsh.tools.units import UAS

#: Points of a band's own posterior where its reach is looked for; twice as many where it is drawn from.
_POINTS = 240
#: The mean square of a wave's displacement over the sky, both polarisations of unit strain [rad²]: (1/6 each).
_WAVE = 1 / 3


@dataclass(frozen=True, eq=False, repr=False)
class TimeBackground(Result):
    """Powers of random fields by band of frequency.

    Attributes
    ----------
    bands : tuple of str
        The functions of each.
    roots : (n, B) array
        Draws of √P: the rms displacement of the sky in each function of a band. [µas]
    weights : (n,) array
        How much each draw counts; they add to one.
    evidence : float
        ln of the mean likelihood over √P up to `reach`, relative to no background.
    reach : (B,) array
        To where √P was flat. [µas]
    spectrum : str
        Which shares of degrees were taken.
    degrees : tuple of int
    n_sources : int
    noise_scale : float
        Factor on the quoted errors, by which they were scaled.
    notes : tuple of str
    """

    bands: tuple[str, ...]
    roots: FloatArray
    weights: FloatArray
    evidence: float
    reach: FloatArray
    spectrum: str
    degrees: tuple[int, ...]
    n_sources: int
    noise_scale: float
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        limits = ", ".join(f"{band} < {limit:.3g} µas" for band, limit in zip(self.bands, self.limits(), strict=True))
        return f"<TimeBackground: {limits} (95 %)>"

    @property
    def effective_draws(self) -> float:
        """Effective number of draws with weights."""
        return float(1 / np.sum(self.weights**2))

    def quantile(self, probability: float) -> FloatArray:
        """√P of each band, (B,), below which it lies with a `probability`. [µas]"""
        level = arguments.between("probability", probability, 0, 1)
        values = []
        for root in self.roots.T:
            order = np.argsort(root)
            share = np.cumsum(self.weights[order]) - self.weights[order] / 2
            values.append(float(np.interp(level, share, root[order])))
        return np.array(values)

    def interval(self, probability: float = 0.68) -> FloatArray:
        """Lower and upper √P of each band, (B, 2), with equal tails and a `probability` between them. [µas]"""
        return np.stack([self.quantile((1 - probability) / 2), self.quantile((1 + probability) / 2)], axis=1)

    def limits(self, probability: float = 0.95) -> FloatArray:
        """√P of each band that is not exceeded with a `probability`, (B,). [µas]"""
        return self.quantile(probability)

    def strain(self, probability: float = 0.95) -> FloatArray:
        """The limit of a `probability` as the strain of each polarisation that moves the sky as much, (B,)."""
        return self.limits(probability) * UAS / np.sqrt(_WAVE)

    @property
    def answer(self) -> Answer:
        """The line to quote: the limit of each band, and the evidence."""
        limits = ", ".join(f"{x:.3g} µas in {band}" for band, x in zip(self.bands, self.limits(), strict=True))
        return Answer((("background", f"√P < {limits} (95 %); ln of the evidence {self.evidence:+.2f}"),))

    def _sections(self, long):
        facts = [
            ("degrees", f"{self.degrees[0]} to {self.degrees[-1]} of {self.n_sources} sources, degree 1 free"),
            ("evidence", f"ln Z {self.evidence:+.2f} against no background; √P has a flat prior"),
            ("errors", f"scaled by {self.noise_scale:.4g}; {self.effective_draws:.0f} effective draws"),
        ]
        return (Section(f"Backgrounds in time, {self.spectrum}: √P by band", facts, self.to_table(), notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each band as an astropy Table."""
        interval = self.interval()
        columns = {
            "band": list(self.bands), "low": interval[:, 0], "high": interval[:, 1], "limit": self.limits(),
            "strain": self.strain(),
        }  # fmt: skip
        return tables.table_of(columns, self._plain_facts(), dict.fromkeys(("low", "high", "limit"), "uas"))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """√P of each band with its limit, on matplotlib axes."""
        from fit.in_time._plot import plot_bands

        return plot_bands(self, ax=ax)


def background(
    equations: TimeEquations,
    bands: Sequence[Sequence[str]] | None = None,
    *,
    spectrum: Spectrum | None = None,
    draws: int = 1000,
    least: float = 200.0,
    rng: Rng = 1,
) -> TimeBackground:
    """The powers of random fields by bands of frequency.

    Parameters
    ----------
    equations : TimeEquations
        To degree 2 at least.
    bands : sequence of sequences of str, optional
        Names of the functions of each band; cosine and sine of a frequency, or one function, unless given. Functions
        that stand in none are fitted freely.
    spectrum : Spectrum, optional
        Shares of degrees and kinds; those of gravitational waves unless given, `Spectrum.flat()` for a floor.
    draws : int
        How many draws of the powers.
    least : float
        So many effective draws at least, or twice as many are drawn, and twice again.
    rng : Generator or int
        Their source.

    Returns
    -------
    TimeBackground
        Draws of the powers, with weights.

    Raises
    ------
    ModesError
        If a band names a function twice, or one that is not there, or there is no degree 2.
    DegeneracyError
        If degree 1 and what is free are not determined.

    Notes
    -----
    On skies drawn with √P of 0 to 3 times the noise 68 % intervals cover .66 to .70 of the truths. Errors are scaled by
    √(χ²/dof). The likelihood is that of `fit.background.fit_amplitudes`, in as many blocks as there are functions.
    """
    arguments.a(TimeEquations)("equations", equations)
    modes, names = equations.modes, equations.functions.names
    if modes.lmax < 2:
        raise ModesError("backgrounds have degrees from 2 on: lmax of 2 or more")
    band_indices = _bands(bands, names)
    matrix, rhs, shapes, scale = _reduce_to_bands(equations, band_indices, spectrum)
    likelihood = Amplitudes(matrix, rhs, shapes)
    rng = generator(rng)
    proposals = [_proposal(likelihood.alone(b)) for b in range(len(band_indices))]
    reach = np.array([root[-1] for root, _ in proposals])
    roots: Any = np.empty((0, len(band_indices)))
    logs: Any = np.empty(0)
    count = arguments.whole("draws", draws)
    for _ in range(5):
        columns, density = zip(
            *(_draw_amplitudes(root, density, count, rng) for root, density in proposals), strict=True
        )
        new_roots = np.stack(columns, axis=1)
        roots = np.concatenate([roots, new_roots])
        logs = np.concatenate(
            [logs, [likelihood.log_likelihood(row**2) for row in new_roots] - np.sum(density, axis=0)]
        )
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        if 1 / np.sum(weights**2) >= min(least, draws / 2):
            break
        count = len(roots)
    evidence = float(np.log(np.mean(np.exp(logs - logs.max()))) + logs.max() - np.log(reach).sum())
    return TimeBackground(
        tuple(_format_names([names[i] for i in band]) for band in band_indices),
        roots,
        weights,
        evidence,
        reach,
        "waves" if spectrum is None else spectrum.name,
        tuple(range(2, modes.lmax + 1)),
        equations.n_sources,
        scale,
        equations.notes,
    )


def _bands(bands, names):
    """Indices of the functions of every band."""
    if bands is None:
        groups: dict[str, list[int]] = {}
        for i, name in enumerate(names):
            groups.setdefault(_bare(name), []).append(i)
        return list(groups.values())
    flat = [name for band in bands for name in band]
    missing = [name for name in flat if name not in names]
    if missing or len(set(flat)) < len(flat) or not all(len(band) for band in bands):
        reason = f"{missing[0]!r} is no function" if missing else "a function stands in two bands, or a band is empty"
        raise ModesError(f"bands name functions, each once: {reason}; there are {', '.join(names)}")
    return [[names.index(name) for name in band] for band in bands]


def _bare(name):
    """The frequency of a cosine or sine; other functions by their name."""
    return name.removeprefix("cos ").removeprefix("sin ")


def _format_names(names):
    """Label of a band."""
    bare = {_bare(name) for name in names}
    return f"{bare.pop()} a year" if len(bare) == 1 and len(names) == 2 else ", ".join(names)


def _reduce_to_bands(equations, bands, spectrum):
    """N and b of the bands' degrees from 2 on, all else free, the shares of each band, and the scale of the errors."""
    modes, f = equations.modes, len(equations.functions)
    variances = _shares(modes, spectrum)
    has_band = np.zeros(f, bool)
    has_band[[i for band in bands for i in band]] = True
    is_background = np.repeat(has_band, len(modes)) & np.tile(modes.degrees > 1, f)
    is_determined = ~equations.unconstrained_terms
    is_free = ~is_background & is_determined
    ridge = 1e-9 * np.diag(np.diag(equations.matrix))  # what parallaxes take tells of nothing
    full_matrix = equations.matrix + ridge
    try:
        best = cho_solve(cho_factor(full_matrix[np.ix_(is_determined, is_determined)]), equations.rhs[is_determined])
        matrix, rhs, _ = eliminate(full_matrix, equations.rhs, is_background, is_free)
    except np.linalg.LinAlgError:
        raise DegeneracyError(
            f"{equations.n_sources} sources do not determine the functions that are fitted freely"
        ) from None
    dof = equations.n_data - 5 * equations.n_sources - int(is_determined.sum())
    quality = Quality(equations.chi2_null - float(equations.rhs[is_determined] @ best), dof)
    tau = quality.reduced if dof > 0 else 1.0
    owner, all_variances = np.repeat(np.arange(f), len(modes))[is_background], np.tile(variances, f)[is_background]
    shapes = np.array([np.where(np.isin(owner, band), all_variances, 0.0) for band in bands])
    return matrix / tau, rhs / tau, shapes, float(np.sqrt(tau))


def _shares(modes, spectrum):
    """Variances of coefficients for a displacement of one µas rms over the sky, degrees from 2 on."""
    if spectrum is None:
        degrees = np.where(modes.degrees > 1, modes.degrees, 2)
        shares = wave_fractions(modes.lmax)[degrees - 1] / (2 * (2 * degrees + 1))
    else:
        shares = np.asarray(spectrum.variances(modes), float) * modes.norm2
    shares = np.where(modes.degrees > 1, shares, 0.0)
    if not (shares.sum() > 0) or (shares < 0).any():
        raise ParameterError("a spectrum has power in degrees from 2 on, and is nowhere negative")
    if spectrum is not None:
        shares = shares / shares.sum()
    return 4 * np.pi * shares / modes.norm2


def _proposal(likelihood):
    """√P of one band, and a density there that is a little wider than its likelihood."""
    unit = float(np.sqrt(likelihood.unit[0]))

    def log(root):
        logdet, gain = likelihood.on_tensor([root])
        return (gain - logdet) / 2

    upper = 4 * unit
    while log(np.array([upper]))[0] > log(np.linspace(0, upper, _POINTS)).max() - 12 and upper < 1e8 * unit:
        upper *= 1.5
    root = np.linspace(0, upper, 2 * _POINTS)
    density = log(root)
    density = np.exp(0.8 * (density - density.max())) + 1e-4
    return root, density / trapezoids(density, root)[-1]


def _draw_amplitudes(root, density, n, rng):
    """Draws from a density on a grid, straight between its points, and ln of it there."""
    share = trapezoids(density, root)
    draws = np.interp(rng.random(n) * share[-1], share, root)
    at = np.clip(np.searchsorted(root, draws, side="right") - 1, 0, len(root) - 2)
    # np.interp of the shares is exact for a density constant between points.
    level = (share[at + 1] - share[at]) / (root[at + 1] - root[at]) / share[-1]
    return draws, np.log(level)
