"""The correlation of motions by the angle between their sources."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fit.pairs._power import checked_edges, covariance_of, sums_of, windows
from fit.pairs._templates import TemplateFit, fitted, names_of
from fit.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notes import note_lines
from vsh.tools.types import ArrayLike, AxesArray, FloatArray, OnAxes, Table

#: The narrowest bin, in units of 1/lmax, that is resolved to 1e-3.
_RESOLVED = 15.0
#: So many times farther than bins ask for go the sums: what noise has beyond is the largest error.
_BEYOND = 1.5


@dataclass(frozen=True, eq=False, repr=False)
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
        return fitted(self, names_of(templates, arguments.positive("hubble", hubble)))

    def report(self) -> str:
        """The correlation by angle as text."""
        lines = [
            (
                f"Correlation of motions by angle: {self.n_data // 2} sources, sums to degree {self.lmax}, no pair of a"
                " source with itself"
            ),
            f"ξ± = ⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩ [(µas/yr)²]; errors from the scatter of {self.n_blocks} blocks of the sky",
            f"{'angle':>8}{'pairs':>12}{'ξ+':>12}{'±':>10}{'ξ−':>12}{'±':>10}",
        ]
        for row in zip(
            np.degrees(self.theta), self.n_pairs, self.plus, self.sigma_plus, self.minus, self.sigma_minus, strict=True
        ):
            angle, pairs, plus, one, minus, two = row
            lines.append(f"{angle:7.2f}°{pairs:12.4g}{plus:12.4g}{one:10.2g}{minus:12.4g}{two:10.2g}")
        return "\n".join([*lines, *note_lines(self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each bin, as an astropy Table."""
        columns = {
            "theta": self.theta,
            "plus": self.plus,
            "sigma_plus": self.sigma_plus,
            "minus": self.minus,
            "sigma_minus": self.sigma_minus,
            "weight": self.weight,
            "n_pairs": self.n_pairs,
        }
        units = {"theta": "rad"} | dict.fromkeys(("plus", "sigma_plus", "minus", "sigma_minus"), "uas2 / yr2")
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
    edges=lambda _, value: checked_edges(value),
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
    if lmax * step < _RESOLVED / 3:
        raise ParameterError(
            f"sums to degree {lmax} do not resolve bins of {np.degrees(step):.2g}°: lmax of {25 / step:.0f} or more, or"
            " wider bins"
        )
    sums_to = int(np.ceil(_BEYOND * lmax))
    total, blocks, frame, notes = sums_of(field, sums_to, nside, weights, threads)
    plus_by, minus_by, scalar_by = windows(edges, sums_to).by_degree
    by_plus, by_minus, by_weight, by_count = total.spectra
    weight, count = scalar_by @ by_weight, scalar_by @ by_count / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        plus_by, minus_by, scalar_by = (each / weight[:, None] for each in (plus_by, minus_by, scalar_by))
    plus, minus = plus_by @ by_plus, minus_by @ by_minus
    zero, expected = np.zeros_like(plus_by), np.concatenate([plus, minus])[:, None] * np.tile(scalar_by, (2, 1))
    covariance = covariance_of(blocks, np.vstack([plus_by, zero]), np.vstack([zero, minus_by]), -expected)
    if lmax * step < _RESOLVED:
        notes = (
            *notes,
            f"sums to degree {lmax} blur bins of {np.degrees(step):.2g}°: lmax {25 / step:.0f} would resolve them",
        )
    if len(blocks) < 4:
        notes = (*notes, f"{len(blocks)} blocks of the sky tell no errors: take a larger nside")
    if (empty := count < 0.5).any():
        notes = (*notes, f"{empty.sum()} bins have no pairs: no values")
        plus, minus = (np.where(empty, np.nan, each) for each in (plus, minus))
    each = np.array([block.weights[0] for block in blocks])  # Σ w Y_00
    return Correlation(
        edges[1:-1],
        plus,
        minus,
        weight / 2,
        count,
        covariance,
        edges,
        by_weight,
        len(blocks),
        frame,
        2 * round(float(total.alone[2])),
        notes,
        float(each.sum() ** 2 / np.sum(each**2)),
    )
