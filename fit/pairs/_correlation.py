"""The correlation of motions by the angle between their sources, and templates of known shape fitted to it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ncfdtr

from fit.pairs._sums import check_bin_edges, find_covariance, make_windows, sum_pairs
from fit.results.quality import SEEN
from fit.results.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.io.sections import Section
from vsh.models.covariance import d_minus, d_plus
from vsh.tools import arguments
from vsh.tools.arguments import between, float_array
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, Axes, AxesArray, FloatArray, OnAxes, Table
from vsh.tools.units import hubble_rate

#: Templates by name, and what their amplitudes are.
TEMPLATES = {
    "spin": "power of T1 [(µas/yr)²]: |ω|² = 3 P/8π",
    "glide": "power of S1 [(µas/yr)²]: |g|² = 3 P/8π",
    "waves": "h70² Ω of gravitational waves",
}


def _format_limit(name: str, upper_limit: float) -> str:
    """Format a limit in words: a vector by its length, whose power is 8π/3 of its square."""
    if name in ("spin", "glide"):
        return f"{name} below {np.sqrt(3 * max(upper_limit, 0.0) / (8 * np.pi)):.3g} µas/yr"
    return f"{'h70² Ω of waves' if name == 'waves' else name} below {upper_limit:.3g}"


def waves_curve(theta: ArrayLike) -> FloatArray:
    """Γ(θ), ξ+ = H0² Ω Γ of an isotropic background: Book & Flanagan (2011, PRD 83, 024024), eq. 74–77."""
    s2 = np.sin(float_array("theta", theta) / 2) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        log_terms = np.where((s2 > 0) & (s2 < 1), s2 * np.log(s2) / (1 - s2), np.where(s2 < 1, 0.0, -1.0))
    return 1 - 7 * s2 - 6 * s2 * log_terms


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TemplateFit(Result):
    """Amplitudes of templates.

    Attributes
    ----------
    names : tuple of str
    values : (t,) array
        Amplitudes, in the units of each (`TEMPLATES`).
    covariance : (t, t) array
        From how blocks of the sky scatter: it knows of the noise, and not of how this sky differs from others.
    curves : (2, k) array
        ξ+ and ξ− that they add up to, in the bins. [(µas/yr)²]
    theta : (k,) array
        Angles of the bins. [rad]
    coefficients : (t,) array
        Number of coefficients, weighed by the template's power in each, whose squares make its amplitude.
    n_effective : float
        Number of blocks from which errors were estimated.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    curves: FloatArray
    theta: FloatArray
    coefficients: FloatArray
    n_effective: float = np.inf

    def __repr__(self) -> str:
        return f"<TemplateFit: {', '.join(f'{n} {v:.3g}' for n, v in zip(self.names, self.values, strict=True))}>"

    def __getitem__(self, name: str) -> tuple[float, float]:
        """The amplitude of one template and its error."""
        if name not in self.names:
            raise ParameterError(f"no template is called {name!r}: {', '.join(self.names)} are")
        index = self.names.index(name)
        return float(self.values[index]), float(self.sigma[index])

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each amplitude, (t,)."""
        return np.sqrt(np.diag(self.covariance))

    def interval(self, probability: float = 0.95) -> FloatArray:
        """Limits of each amplitude, (t, 2), with `probability` between them; none is below zero.

        An amplitude is a sum of squares of k coefficients less their noise s², which is k χ² and no Gaussian: its own
        error goes with it. With Var = 2 k s⁴ + 4 s² P both follow from value and error, and the limits from the
        non-central F of k and the number of blocks, less one.

        Notes
        -----
        Where there is nothing but noise, 95 % cover zero on 93 to 99 % of skies (1500 sources all over the sky, on
        half of it, in clusters, 8 that dominate, errors three times too small on a third of the sky; 60 sources),
        where value ± 1.96 errors holds it on 84 to 95.
        """
        tail = (1 - between("probability", probability, 0.0, 1.0)) / 2
        dof = max(self.n_effective - 1, 2.0)
        return np.array(
            [_compute_interval(*row, tail, dof) for row in zip(self.values, self.sigma, self.coefficients, strict=True)]
        )

    @property
    def verdict(self) -> str:
        """State which templates are detected in the pairs: as large by chance in less than 0.27 % each."""
        # From zero upward: half of what is outside of an interval is below it.
        lower_limits = self.interval(1 - 2 * SEEN)[:, 0]
        detections = [name for name, lower in zip(self.names, lower_limits, strict=True) if lower > 0]
        if detections:
            return (
                f"pairs show {', '.join(detections)}, of the sky or of systematic errors, which pairs do not separate: "
                "a fit of harmonics does (vsh-fit --waves)"
            )
        limits = [_format_limit(name, upper) for name, (_, upper) in zip(self.names, self.interval(0.9), strict=True)]
        return f"none of the templates is detected (p < 0.0027): {', '.join(limits)} (95 %)"

    def _sections(self, long):
        table = self.to_table()
        table["meaning"] = [TEMPLATES.get(name, "") for name in self.names]
        origin = "from the scatter between blocks of the sky; the 95 % intervals allow for the distribution of sums of"
        facts, forms = [("errors", f"{origin} squares")], dict.fromkeys(("low95", "high95"), ".3g")
        return (Section("Templates in the correlation of motions", facts, table, forms=forms),)

    def to_table(self) -> Table:
        """A row for each template, as an astropy Table."""
        columns = {"template": list(self.names), "value": self.values, "sigma": self.sigma}
        return tables.table_of(columns | dict(zip(("low95", "high95"), self.interval().T, strict=True)))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The curves, on matplotlib axes."""
        from fit.pairs._plot import plot_curves

        return plot_curves(self, ax=ax)


def make_template_functions(templates: Any, hubble: float) -> dict[str, Callable[[FloatArray], FloatArray]]:
    """Make functions of θ of the templates, that give ξ+ and ξ−, (2, n), by name."""
    if isinstance(templates, Mapping) and templates:
        for name, function in templates.items():
            if not callable(function):
                raise ParameterError(f"template {name!r} must be a function of θ [rad], not {type(function).__name__}")
        return dict(templates)
    if isinstance(templates, str) or not isinstance(templates, Sequence) or not templates:
        raise ParameterError(f"templates are some of {', '.join(TEMPLATES)}, or functions by name, not {templates!r}")
    functions = {
        "spin": lambda theta: np.concatenate([d_plus(1, theta), d_minus(1, theta)]) / (4 * np.pi),
        "glide": lambda theta: np.concatenate([d_plus(1, theta), -d_minus(1, theta)]) / (4 * np.pi),
        "waves": lambda theta: np.stack([hubble_rate(hubble) ** 2 * waves_curve(theta), 0 * theta]),
    }
    unknown_names = [name for name in templates if name not in functions]
    if unknown_names:
        raise ParameterError(
            f"no template is called {unknown_names[0]!r}: {', '.join(TEMPLATES)} are, or give functions by name"
        )
    return {name: functions[name] for name in templates}


def fit_templates(correlation: Any, templates: dict[str, Callable[[FloatArray], FloatArray]]) -> TemplateFit:
    """Amplitudes by least squares, with the weight of the pairs in each bin."""
    bins, has_pairs = make_windows(correlation.edges, correlation.lmax), np.isfinite(correlation.plus)
    pair_weights = bins.values * (correlation.window @ bins.scalar)  # as the pairs spread within each bin
    curves = []
    for name, function in templates.items():
        curve = float_array(f"the template {name!r}", function(bins.theta), (2, len(bins.theta)))
        curves.append(curve @ pair_weights.T / pair_weights.sum(1))
    design = np.array(curves)[:, :, has_pairs].reshape(len(curves), -1)
    root_weights = np.sqrt(np.tile(correlation.weight[has_pairs], 2))
    if design.shape[1] < len(curves) or np.linalg.matrix_rank(design * root_weights) < len(curves):
        raise ParameterError(
            f"{has_pairs.sum()} bins cannot tell {len(curves)} templates apart: take more bins, at more angles"
        )
    pseudoinverse = np.linalg.pinv((design * root_weights).T) * root_weights
    values = pseudoinverse @ np.stack([correlation.plus, correlation.minus])[:, has_pairs].ravel()
    is_used = np.tile(has_pairs, 2)
    covariance = pseudoinverse @ correlation.covariance[np.ix_(is_used, is_used)] @ pseudoinverse.T
    if not np.isfinite(covariance).all():
        raise ParameterError("these sources give no errors of the correlation: they are too few, or too close together")
    return TemplateFit(
        names=tuple(templates),
        values=values,
        covariance=(covariance + covariance.T) / 2,
        curves=np.tensordot(values, np.array(curves), 1),
        theta=correlation.theta,
        coefficients=np.array([_count_template_coefficients(function) for function in templates.values()]),
        n_effective=correlation.n_effective,
    )


def _compute_interval(value, sigma, k, tail, dof):
    """Compute the interval of one amplitude."""
    # Var = 2 k s⁴ + 4 s² P, P the value as it is.
    s2 = (np.sqrt(16 * value**2 + 8 * k * sigma**2) - 4 * value) / (4 * k)
    ratio = max(value / s2 + k, 0.0) / k  # P/s² + k over k
    return tuple(s2 * _solve_noncentrality(ratio, k, min(dof, 1e4), p) for p in (1 - tail, tail))


def _solve_noncentrality(ratio, k, dof, p):
    """Solve for the non-centrality for which an F of k and dof degrees is as small with probability p, or give zero."""
    if ncfdtr(k, dof, 0.0, ratio) <= p:
        return 0.0
    # By halving: the function is nan where it is below 1e-28, which `>` takes for small and a root finder does not.
    lower, upper = 0.0, 4 * k * (ratio + 10)
    while ncfdtr(k, dof, upper, ratio) > p:
        lower, upper = upper, 2 * upper
    while upper - lower > 1e-10 * upper:
        middle = (lower + upper) / 2
        lower, upper = (middle, upper) if ncfdtr(k, dof, middle, ratio) > p else (lower, middle)
    return (lower + upper) / 2


def _count_template_coefficients(function, lmax=40):
    """Count the coefficients, (Σ P)²/Σ P²/(2l + 1), of a template over degrees and kinds: 3 for spin, 13 for waves."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    theta = np.arccos(nodes)
    plus, minus = function(theta) * weights
    degrees = 2 * np.arange(1, lmax + 1) + 1
    total, difference = degrees * (d_plus(lmax, theta) @ plus), degrees * (d_minus(lmax, theta) @ minus)
    powers = np.maximum([total + difference, total - difference], 0.0)
    return float(powers.sum() ** 2 / max(np.sum(powers**2 / degrees), 1e-300)) or 1.0


#: The narrowest bin, in units of 1/lmax, that is resolved to 1e-3.
_RESOLVED_STEP = 15.0
#: So many times farther than bins ask for go the sums: what noise has beyond is the largest error.
_DEGREE_RATIO = 1.5


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Correlation(Result):
    """ξ± of motions in bins of angle.

    Attributes
    ----------
    theta : (k,) array
        Where each bin has its top. [rad]
    plus, minus : (k,) arrays
        ξ± = ⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩ of the motions along and across the great circle through both sources, both directions
        pointing away from the first. [(µas/yr)²]
    weight : (k,) array
        Σ w w' over the pairs, each counted once.
    n_pairs : (k,) array
        How many pairs, each counted once and as far as the bin sees it; of a bin that is smooth no whole number.
    covariance : (2k, 2k) array
        Covariance of ξ+ and then ξ−, by the scatter of blocks and their pairs; nan of less than four. [(µas/yr)⁴]
    edges : (k + 2,) array
        Edges of the bins: each rises from one edge to the next as sin², and falls to the one after. [rad]
    window : (lmax + 1,) array
        Pairs by degree, in weight: how they spread over the angles.
    n_blocks : int
        How many.
    frame : str
    n_data : int
        Two a source.
    notes : tuple of str
    n_effective : float
        How many blocks of equal weight they are worth, (Σ W)²/Σ W².
    """

    theta: FloatArray
    plus: FloatArray
    minus: FloatArray
    weight: FloatArray
    n_pairs: FloatArray
    covariance: FloatArray
    edges: FloatArray
    window: FloatArray
    n_blocks: int
    frame: str
    n_data: int
    notes: tuple[str, ...] = ()
    n_effective: float = np.inf

    def __repr__(self) -> str:
        return f"<Correlation: {len(self.theta)} bins, {self.n_data // 2} sources>"

    @property
    def lmax(self) -> int:
        """The highest degree of the sums."""
        return len(self.window) - 1

    @property
    def sigma_plus(self) -> FloatArray:
        """Standard error of ξ+, (k,). [(µas/yr)²]

        Right within a sixth with the 48 blocks of nside 2, for noise of any size and for fields that change from sky
        to sky; too large for a spin, a glide or the lowest degrees of this one sky, which differ from block to block
        as other skies would: take them away first.
        """
        return np.sqrt(np.diag(self.covariance))[: len(self.theta)]

    @property
    def sigma_minus(self) -> FloatArray:
        """Standard error of ξ−, (k,). [(µas/yr)²]"""
        return np.sqrt(np.diag(self.covariance))[len(self.theta) :]

    def fit(
        self,
        templates: Sequence[str] | Mapping[str, Callable[[FloatArray], FloatArray]] = ("spin", "glide", "waves"),
        *,
        hubble: float = 70.0,
    ) -> TemplateFit:
        """The amplitudes of fields of known shape, by least squares with the pairs of each bin for weights.

        Parameters
        ----------
        templates : sequence of str, or dict of functions
            Some of "spin", "glide", "waves"; or, by name, functions of θ [rad] that give ξ+ and ξ−, (2, n).
        hubble : float
            For which Ω is meant; 70 makes it h70² Ω. [km/s/Mpc]

        Returns
        -------
        TemplateFit
            Its errors follow from `covariance`.

        Raises
        ------
        ParameterError
            If a template is unknown, or bins are fewer than templates.
        """
        return fit_templates(self, make_template_functions(templates, arguments.positive("hubble", hubble)))

    def _sections(self, long):
        remark = "pairs of a source with itself are excluded"
        facts = [
            ("sources", f"{self.n_data // 2}; harmonic sums to degree {self.lmax}; {remark}"),
            ("ξ±", "⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩; errors from the scatter of " + f"{self.n_blocks} blocks of the sky"),
        ]
        columns = ("theta", "n_pairs", "plus", "sigma_plus", "minus", "sigma_minus")
        forms = {"theta": ".2f", "n_pairs": ".4g"}
        title = "Correlation of motions by angle"
        return (Section(title, facts, self.to_table(), columns, forms=forms, notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each bin, as an astropy Table."""
        names = ("theta", "plus", "sigma_plus", "minus", "sigma_minus", "weight", "n_pairs")
        columns = {name: getattr(self, name) for name in names}
        units = {"theta": "rad"} | dict.fromkeys(names[1:5], "uas2 / yr2")
        return tables.table_of(columns, self._plain_facts(), units)

    def plot(self, fit: TemplateFit | None = None, *, ax: OnAxes | None = None) -> AxesArray:
        """ξ± with errors, the curve of fitted templates, and the pairs in each bin, on matplotlib axes.

        Parameters
        ----------
        fit : TemplateFit, optional
            What `fit` found.
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.pairs._plot import plot_pairs

        return plot_pairs(self, fit, ax=ax)


@arguments.accepts(
    field=arguments.a(Field, Parts),
    edges=lambda _, value: check_bin_edges(value),
    nside=arguments.whole,
    lmax=arguments.whole,
)
def correlation_function(
    field: Field | Parts,
    edges: ArrayLike,
    *,
    lmax: int | None = None,
    nside: int = 2,
    weights: ArrayLike | None = None,
    threads: int | None = None,
) -> Correlation:
    """The correlation of motions in bins of angle, of any number of sources, in a time that grows as they do.

    No source is paired with itself, so errors of sources, of any size, add noise and no bias; motions that sources
    share are what is seen. Take a fitted field away first, `field.minus(solution.model(field))`, to see what is left.

    Parameters
    ----------
    field : Field or Parts
        The sources. Parts are gone through once.
    edges : (k + 2,) array
        Edges of k smooth bins: bin i rises from edges[i] to edges[i + 1] as sin², and falls to edges[i + 2]; next to
        each other they add up to one. [rad, from 0 to π]
    lmax : int, optional
        To which the bins are resolved: 25 over the narrowest step between edges unless given. Sums go half as far
        again, and give ξ+ as all pairs would to 1e-4 of its largest value, ξ− to 2e-4.
    nside : int
        Resolution of the HEALPix blocks whose scatter gives the errors.
    weights : (n,) array, optional
        Weights of each source of a Field; 2/(σ_α*² + σ_δ²) unless given. They must not follow from the motions: sources
        that fit would count more.
    threads : int, optional
        How many; one a core unless given. Their number changes no bit.

    Raises
    ------
    ParameterError
        If the edges do not ascend from 0 to π, or sums to lmax do not resolve the bins.
    FieldError
        If there are fewer than two sources.

    Notes
    -----
    Pseudo-spectra of the weighted motions (Hivon et al. 2002, ApJ 567, 2; Szapudi et al. 2001, ApJ 548, L115), for
    motions with Wigner's d^l_{1,±1}; self-pairs are taken from every degree.

    Examples
    --------
    A glide alone: ξ+ = g² (1 + cos θ)/3.

    >>> from vsh import Coefficients
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
    >>> glide = Coefficients.from_vectors(glide=(0, 0, 3.0)).at(lon, lat)
    >>> result = correlation_function(Field(lon, lat, glide, np.ones((2, 2000))), np.radians([80, 90, 100]))
    >>> round(float(result.plus[0]))
    3
    """
    edges = np.asarray(edges, float)
    step = float(np.diff(edges).min())
    lmax = int(np.ceil(25 / step)) if lmax is None else lmax
    if lmax * step < _RESOLVED_STEP / 3:
        raise ParameterError(
            f"sums to degree {lmax} do not resolve bins of {np.degrees(step):.2g}°: lmax of {25 / step:.0f} or more, or"
            " wider bins"
        )
    sum_degree = int(np.ceil(_DEGREE_RATIO * lmax))
    total, blocks, frame, notes = sum_pairs(field, sum_degree, nside, weights, threads)
    plus_bins, minus_bins, scalar_bins = make_windows(edges, sum_degree).by_degree
    plus_power, minus_power, weight_power, count_power = total.spectra
    weight, pair_counts = scalar_bins @ weight_power, scalar_bins @ count_power / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        plus_bins, minus_bins, scalar_bins = (bins / weight[:, None] for bins in (plus_bins, minus_bins, scalar_bins))
    plus, minus = plus_bins @ plus_power, minus_bins @ minus_power
    zero, expectation = np.zeros_like(plus_bins), np.concatenate([plus, minus])[:, None] * np.tile(scalar_bins, (2, 1))
    covariance = find_covariance(blocks, np.vstack([plus_bins, zero]), np.vstack([zero, minus_bins]), -expectation)
    if lmax * step < _RESOLVED_STEP:
        notes = (
            *notes,
            f"sums to degree {lmax} blur bins of {np.degrees(step):.2g}°: lmax {25 / step:.0f} would resolve them",
        )
    if len(blocks) < 4:
        notes = (*notes, f"{len(blocks)} blocks of the sky tell no errors: take a larger nside")
    if (is_empty := pair_counts < 0.5).any():
        notes = (*notes, f"{is_empty.sum()} bins have no pairs: no values")
        plus, minus = (np.where(is_empty, np.nan, xi) for xi in (plus, minus))
    block_weights = np.array([block.weights[0] for block in blocks])  # Σ w Y_00
    return Correlation(
        theta=edges[1:-1],
        plus=plus,
        minus=minus,
        weight=weight / 2,
        n_pairs=pair_counts,
        covariance=covariance,
        edges=edges,
        window=weight_power,
        n_blocks=len(blocks),
        frame=frame,
        n_data=2 * round(float(total.self_pairs[2])),
        notes=notes,
        n_effective=float(block_weights.sum() ** 2 / np.sum(block_weights**2)),
    )
