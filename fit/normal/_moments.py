"""What adds: the Fourier moments of the sources' weights and motions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fit.normal._equations import Additive, NormalEquations
from fit.normal.sums import make_rings, sum_fourier_moments
from fit.results.storage import Result, check_count, check_strings, from_hex, to_hex
from vsh.field import Field
from vsh.io.parts import Parts
from vsh.io.sections import Section
from vsh.modes import Modes, ScalarModes, as_modes
from vsh.scalars import ScalarField, modes_for
from vsh.sky.frames import check_frame
from vsh.sky.pixels import centres
from vsh.tools import arguments
from vsh.tools.errors import EmptyFieldError, FrameError, ModesError, TableError
from vsh.tools.types import Axes, ComplexArray, FloatArray


def find_moment_shapes(mode_class: type[Modes], lmax: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Find the shapes of the moments of weights and of values."""
    n_weights, n_values = (1, 1) if mode_class is ScalarModes else (3, 2)
    return (n_weights, 2 * lmax + 1, 4 * lmax + 1), (n_values, lmax + 1, 2 * lmax + 1)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Moments(Additive, Result):
    """All that fits to any degree up to `lmax` need of the sources; they add, to the lower of two degrees.

    The inverse covariances enter normal equations in products of two harmonics, which are trigonometric polynomials in
    α and δ: so of the sources no more is needed than the Fourier moments of their weights to twice the degree, and of
    their weighted motions to the degree. That is 10 times less to send than normal equations of degree 10, and 70
    times less at degree 30.

    Attributes
    ----------
    lmax : int
        The highest degree.
    weights : (3, 2 lmax + 1, 4 lmax + 1) complex array; (1, …) of a scalar field
        Σ w e^{−i(Mα + nδ)} of the inverse covariance [[a, c], [c, b]], w = a, b, c, for M = 0 … 2 lmax and
        n = −2 lmax … 2 lmax. [(yr/µas)²]
    motions : (2, lmax + 1, 2 lmax + 1) complex array; (1, …) of a scalar field
        The same of the two components of C⁻¹ µ, to lmax. [yr/µas]
    chi2_null : float
        Σ µᵀ C⁻¹ µ, the χ² of fitting nothing.
    n_data : int
        How many numbers went in: two a source, one of a scalar field.
    frame : str
        Frame of the axes.
    notes : tuple of str
        The notes of the fields.
    unit : str
        Unit of the values that were summed.

    Examples
    --------
    One pass serves every degree:

    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 100)), rng.normal(size=(2, 100)), np.ones((2, 100)))
    >>> moments = Moments.of(field, 5)
    >>> moments.normal_equations(2)
    <NormalEquations: 200 numbers, degree 2, icrs>
    """

    lmax: int
    weights: ComplexArray
    motions: ComplexArray
    chi2_null: float
    n_data: int
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    unit: str = "µas/yr"

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        lmax = self.kind(self.lmax).lmax
        for name, shape in zip(("weights", "motions"), find_moment_shapes(self.kind, lmax), strict=True):
            if (moments := np.asarray(getattr(self, name), complex)).shape != shape:
                raise ModesError(f"the moments of {name} of degree {lmax} have the shape {shape}, not {moments.shape}")
            object.__setattr__(self, name, moments)
        check_frame(self.frame)
        super().__post_init__()

    @property
    def kind(self) -> type[Modes]:
        """Kind of modes: `Modes`, or `ScalarModes` of a scalar field."""
        return ScalarModes if len(self.weights) == 1 else Modes

    @property
    def n_sources(self) -> int:
        """Number of sources."""
        return self.n_data // self.kind.components

    @classmethod
    def of(cls, field: Field | ScalarField | Parts, lmax: Modes | int, *, threads: int | None = None) -> Moments:
        """The moments of sources.

        Parameters
        ----------
        field : Field, ScalarField or Parts
            The sources. Parts are summed where they are.
        lmax : int, or Modes
            The highest degree.
        threads : int, optional
            How many; one a core unless given. Their number changes no bit.

        Raises
        ------
        ParameterError
            If the sources are no Field and no Parts.
        """
        lmax = modes_for(field, lmax).lmax
        if isinstance(field, Parts):
            return field.sum(partial(cls.of, lmax=lmax), roles=(), words="moments")
        if not len(arguments.a(Field, ScalarField, Parts)("field", field)):
            raise EmptyFieldError("the field is empty: there are no sources to use")
        weights, motions, chi2_null = sum_fourier_moments(field, lmax, threads)
        return cls(
            lmax=lmax,
            weights=weights,
            motions=motions,
            chi2_null=chi2_null,
            n_data=field.components * len(field),
            frame=field.frame,
            notes=field.notes,
            unit=field.unit,
        )

    def __repr__(self) -> str:
        return f"<Moments: {self.n_data} numbers, to degree {self.lmax}, {self.frame}>"

    def to_degree(self, lmax: Modes | int) -> Moments:
        """Cut to the lower degree `lmax`.

        Raises
        ------
        ModesError
            If it is above theirs.
        """
        lmax = as_modes(lmax, self.kind).lmax
        degree_change = lmax - self.lmax
        if degree_change > 0:
            raise ModesError(f"moments of degree {self.lmax} do not hold degree {lmax}: sum sources to degree {lmax}")
        if degree_change == 0:
            return self
        return replace(
            self,
            lmax=lmax,
            weights=self.weights[:, : 2 * lmax + 1, -2 * degree_change : 2 * degree_change],
            motions=self.motions[:, : lmax + 1, -degree_change:degree_change],
        )

    def normal_equations(self, modes: Modes | int | None = None) -> NormalEquations:
        """Normal equations of any degree up to theirs.

        Parameters
        ----------
        modes : Modes, or a degree, optional
            What to fit; all that the moments hold unless given.

        Raises
        ------
        ModesError
            If the degree is above theirs.
        """
        modes = as_modes(self.lmax if modes is None else modes, self.kind)
        moments, rings = self.to_degree(modes.lmax), make_rings(modes)
        return NormalEquations(
            modes,
            rings.matrix(moments.weights),
            rings.rhs(moments.motions),
            self.chi2_null,
            self.n_data,
            self.frame,
            self.notes,
            unit=self.unit,
        )

    def on_sky(self) -> tuple[FloatArray, FloatArray]:
        """Compute the weight of the sources on the sky, at the resolution of the moments.

        Returns
        -------
        lat : (2 lmax + 1,) array
            Latitudes of the rings. [rad]
        weight : (2 lmax + 1, 4 lmax + 2) array
            Half the trace of the inverse covariances, at longitudes from 0 on; it can be negative in places.
            [(yr/µas)²/sr]
        """
        rings, components = make_rings(self.kind(self.lmax)), self.kind.components
        grid_weight = rings.on_grid(self.weights)[:components].mean(0)
        return rings.lat, grid_weight / (np.cos(rings.lat) * 2 * np.pi**2 / grid_weight.size)[:, None]

    def _sections(self, long):
        weight = self.weights[: self.kind.components, 0].sum(0)[2 * self.lmax].real / self.n_data
        error = 1 / np.sqrt(weight) if weight > 0 else np.inf
        facts = [
            ("sources", f"{self.n_sources}, {self.frame} axes"),
            ("size", f"{(self.weights.nbytes + self.motions.nbytes) / 1e3:.4g} kB"),
            ("mean error", f"{error:.4g} {self.unit}, weighted"),
            ("χ² of nothing", f"{self.chi2_null:.6g} of {self.n_data} numbers"),
        ]
        return (Section(f"Moments of a catalogue to degree {self.lmax}", facts, notes=self.notes),)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The weight of the sources on the sky, on matplotlib axes."""
        from vsh.figures.plot import plot_map

        lat, weight = self.on_sky()
        pixel_lon, pixel_lat = centres(32)
        ring_index = np.abs(pixel_lat[:, None] - lat).argmin(1)
        lon_index = np.round(pixel_lon / (2 * np.pi) * weight.shape[1]).astype(int) % weight.shape[1]
        weights = weight[ring_index, lon_index]
        label = f"weight of the sources  [1/({self.unit})² a steradian]"
        options = {"title": f"{self.n_sources} sources, to degree {self.lmax}", "extend": "max"}
        return plot_map(weights, label, frame=self.frame, ax=ax, vmin=0, vmax=np.percentile(weights, 99), **options)

    def _pack(self):
        letters, m, n, flat_grids = [], [], [], []
        for grid_letters, grids, half_width in (("abc", self.weights, 2 * self.lmax), ("en", self.motions, self.lmax)):
            for letter, grid in zip(grid_letters, grids, strict=False):  # a and e alone of a scalar field
                indices = np.indices(grid.shape)
                letters += [letter] * grid.size
                m.append(indices[0].ravel())
                n.append(indices[1].ravel() - half_width)
                flat_grids.append(grid.ravel())
        moments = np.concatenate(flat_grids)
        columns = {"of": letters, "m": np.concatenate(m), "n": np.concatenate(n)}
        columns |= {"real": moments.real, "imaginary": moments.imag}
        metadata = {"lmax": self.lmax, "chi2_null": to_hex(self.chi2_null), "n_data": self.n_data}
        metadata |= {"frame": self.frame, "unit": self.unit, "notes": list(map(str, self.notes))}
        return columns, metadata, {}

    @classmethod
    def _unpack(cls, columns, metadata):
        mode_class = Modes if "b" in columns["of"] else ScalarModes
        lmax = mode_class(metadata["lmax"]).lmax
        moments = np.asarray(columns["real"], float) + 1j * np.asarray(columns["imaginary"], float)
        if not np.isfinite(moments).all():
            raise TableError("moments that are not finite")
        weights_shape, motions_shape = find_moment_shapes(mode_class, lmax)
        n_weights = int(np.prod(weights_shape))
        return cls(
            lmax=lmax,
            weights=moments[:n_weights].reshape(weights_shape),
            motions=moments[n_weights:].reshape(motions_shape),
            chi2_null=from_hex(metadata["chi2_null"]),
            n_data=check_count(metadata["n_data"]),
            frame=metadata["frame"],
            notes=check_strings(metadata["notes"]),
            unit=str(metadata["unit"]),
        )

    def _add_with_sign(self, other, sign):
        if not isinstance(other, Moments):
            return NotImplemented
        if self.frame != other.frame:
            raise FrameError(
                f"cannot add moments in {self.frame} and {other.frame} axes: "
                f'take one field .to_frame("{self.frame}") first'
            )
        if (self.kind, self.unit) != (other.kind, other.unit):
            raise ModesError(f"cannot add moments of values in {self.unit or 'no unit'} and {other.unit or 'no unit'}")
        lmax = min(self.lmax, other.lmax)
        names = ("weights", "motions", "chi2_null", "n_data")
        return self.to_degree(lmax)._combine_sums(other.to_degree(lmax), sign, names)
