"""Expansion that differs from axis to axis: the traceless tensor behind the spheroidal coefficients of degree 2."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fit.background import compute_contrast_p_value, pool_draw_covariances, resample_draws, sample_class_errors
from fit.normal import NormalEquations, solve
from fit.results.solution import Solution
from fit.results.storage import Result
from vsh.coefficients import Coefficients
from vsh.io import tables
from vsh.io.sections import Section
from vsh.length import length_limits
from vsh.modes import Modes
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import angles
from vsh.tools import arguments
from vsh.tools.arguments import between, covariance, float_array, generator, positive, read_only
from vsh.tools.digits import format_p_value
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.types import ArrayLike, Axes, BoolArray, FloatArray, Rng, Table
from vsh.tools.units import hubble_rate

__all__ = ["Shear", "ShearByClass", "compare_expansions", "expansion", "from_tensor", "to_tensor"]


#: The five coefficients (2,0), (2,1,re), (2,1,im), (2,2,re), (2,2,im) from Σ_zz, Σ_xz, Σ_yz, Σ_xx − Σ_yy, Σ_xy.
_COEFFICIENT_FACTORS = np.sqrt(np.pi / 5) * np.array([np.sqrt(6), -2, 2, 1, -2])
#: Σ_xx, Σ_yy, Σ_zz, Σ_xy, Σ_xz, Σ_yz from the coefficients.
TO_TENSOR = (
    np.array([
        [-0.5, 0, 0, 0.5, 0], [-0.5, 0, 0, -0.5, 0], [1, 0, 0, 0, 0], [0, 0, 0, 0, 1], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0],
    ]) / _COEFFICIENT_FACTORS
)  # fmt: skip
COMPONENT_INDICES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def from_tensor(tensor: ArrayLike) -> Coefficients:
    """The coefficients of µ = Σ r − (rᵀ Σ r) r, which is of degree 2 and spheroidal.

    Parameters
    ----------
    tensor : (3, 3) array
        Σ, symmetric; a trace makes no difference. [µas/yr]

    Returns
    -------
    Coefficients
        Coefficients of degree 2.

    Raises
    ------
    ParameterError
        If the tensor is not symmetric.

    Examples
    --------
    >>> bool(np.isclose(from_tensor(np.diag([-1, -1, 2])).values[11], np.sqrt(6 * np.pi / 5) * 2))
    True
    """
    tensor = float_array("the tensor", tensor, (3, 3))
    if not np.allclose(tensor, tensor.T, rtol=1e-12, atol=1e-12 * np.abs(tensor).max()):
        raise ParameterError("the tensor of an expansion is symmetric")
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = tensor - np.eye(3) * np.trace(tensor) / 3
    values = np.zeros(16)
    values[Modes(2).slice_of("S", 2)] = _COEFFICIENT_FACTORS * np.array([zz, xz, yz, xx - yy, xy])
    return Coefficients(Modes(2), values)


@arguments.accepts(coefficients=arguments.a(Coefficients))
def to_tensor(coefficients: Coefficients) -> FloatArray:
    """Σ, traceless, of the spheroidal coefficients of degree 2. [µas/yr]

    Parameters
    ----------
    coefficients : Coefficients
        To degree 2 at least.

    Raises
    ------
    ModesError
        If there is no degree 2.
    """
    return make_symmetric_tensor(TO_TENSOR @ coefficients.values[spheroidal_degree_two(coefficients.modes)])


def spheroidal_degree_two(modes: Modes) -> slice:
    """Indices of the spheroidal coefficients of degree 2."""
    if modes.lmax < 2 or modes.components != 2:
        raise ModesError("an expansion that differs from axis to axis is of degree 2: fit motions to degree 2 at least")
    return modes.slice_of("S", 2)


def make_symmetric_tensor(components: FloatArray) -> FloatArray:
    """Make a symmetric matrix of its components xx, yy, zz, xy, xz, yz."""
    matrix = np.empty((3, 3))
    for (i, j), value in zip(COMPONENT_INDICES, components, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


_COMPONENT_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Shear(Result):
    """An expansion that differs from axis to axis.

    Attributes
    ----------
    tensor : (3, 3) array
        Σ, traceless: the rate along each axis less the mean. [µas/yr]
    covariance : (6, 6) array
        Covariance of Σ_xx, Σ_yy, Σ_zz, Σ_xy, Σ_xz, Σ_yz; of rank 5. [(µas/yr)²]
    p_value : float
        Probability of as much from noise alone.
    hubble : float
        To which rates are compared. [km/s/Mpc]
    frame : str
        Frame of the axes.
    n_data : int
    notes : tuple of str
    """

    tensor: FloatArray
    covariance: FloatArray
    p_value: float
    hubble: float
    frame: str
    n_data: int
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        check_frame(self.frame)
        object.__setattr__(self, "tensor", read_only(float_array("the tensor", self.tensor, (3, 3))))
        object.__setattr__(self, "covariance", covariance("the covariance of a tensor", self.covariance, 6))
        super().__post_init__()

    def __repr__(self) -> str:
        return f"<Shear: |Σ| = {self.norm:.3g} µas/yr, p = {format_p_value(self.p_value)}>"

    @property
    def values(self) -> FloatArray:
        """Σ_xx, Σ_yy, Σ_zz, Σ_xy, Σ_xz, Σ_yz, (6,). [µas/yr]"""
        return np.array([self.tensor[index] for index in COMPONENT_INDICES])

    @property
    def sigma(self) -> FloatArray:
        """Their standard errors, (6,). [µas/yr]"""
        return np.sqrt(np.diag(self.covariance))

    @property
    def norm(self) -> float:
        """|Σ|, the root of the sum of squares; noise makes it too large. P_S2 = (4π/5) |Σ|². [µas/yr]"""
        return float(np.linalg.norm(self.tensor))

    @property
    def eigenvalues(self) -> FloatArray:
        """Rates along the principal axes less their mean, the largest first, (3,). [µas/yr]"""
        return np.linalg.eigh(self.tensor)[0][::-1]

    @property
    def axes(self) -> FloatArray:
        """Principal axes in rows, (3, 3), without sign; undetermined where two rates are equal within errors."""
        vectors = np.linalg.eigh(self.tensor)[1][:, ::-1].T
        return vectors * np.where(vectors[:, 2:] < 0, -1, 1)

    @property
    def eigenvalue_errors(self) -> FloatArray:
        """Standard errors of the rates, (3,), to first order. [µas/yr]

        Good where the rates are several of them apart; two that are closer push each other apart, and scatter less.
        """
        products = np.array([[v[i] * v[j] * (1 + (i != j)) for i, j in COMPONENT_INDICES] for v in self.axes])
        return np.sqrt(np.einsum("ki,ij,kj->k", products, self.covariance, products))

    def limit(self, probability: float = 0.95) -> float:
        """Upper limit of |Σ|: a larger one would have been found larger with `probability`. [µas/yr]

        Its coverage is at least this probability at any signal to noise (`vsh.length.length_limits`).
        """
        between("probability", probability, 0, 1)
        root_multiplicity = np.sqrt([1, 1, 1, 2, 2, 2])
        scaled_covariance = np.outer(root_multiplicity, root_multiplicity) * self.covariance
        return float(length_limits((root_multiplicity * self.values)[None], scaled_covariance[None], probability)[0])

    def percent(self, rate: ArrayLike) -> FloatArray:
        """A `rate` [µas/yr] in per cent of H0."""
        return 100 * np.asarray(rate, float) / hubble_rate(self.hubble)

    def to_frame(self, name: str) -> FloatArray:
        """Σ along the axes of the frame `name` (icrs, galactic, ecliptic), (3, 3). [µas/yr]"""
        rotation = rotation_matrix(self.frame, name)
        return rotation @ self.tensor @ rotation.T

    def _sections(self, long):
        norm, limit = self.norm, self.limit()
        size = f"{norm:.3g} µas/yr as fitted, {self.percent(norm):.3g} % of H0 = {self.hubble:g}"
        facts = [
            ("sources", f"{self.n_data // 2}, degree 2, {self.frame} axes"),
            ("p-value", f"{format_p_value(self.p_value)} of as much from noise alone"),
            ("|Σ|", f"{size}; below {limit:.3g} µas/yr, {self.percent(limit):.3g} % (95 %)"),
        ]
        directions = np.array([angles(rotation_matrix(self.frame, "galactic") @ axis) for axis in self.axes])
        lon, lat = np.degrees(directions).T
        columns = {"rate": self.eigenvalues, "rate_error": self.eigenvalue_errors}
        columns |= {"% of H0": self.percent(self.eigenvalues), "l": lon % 360, "b": lat}
        axes_table = tables.table_of(columns, {}, {"rate": "uas / yr", "l": "deg", "b": "deg"})
        forms = {"% of H0": "+.3g", "l": ".1f", "b": "+.1f"}
        return (
            Section("Expansion that differs from axis to axis: the tensor Σ", facts, self.to_table()),
            Section("Principal axes", (), axes_table, forms=forms, notes=self.notes),
        )

    def to_table(self) -> Table:
        """A row for each component, as an astropy Table."""
        columns = {"component": list(_COMPONENT_NAMES), "value": self.values, "sigma": self.sigma}
        return tables.table_of(columns, self._plain_facts(), dict.fromkeys(("value", "sigma"), "uas / yr"))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The motions and the principal axes on the sky, on matplotlib axes."""
        from fit.motions.figures import plot_shear

        return plot_shear(self, from_tensor(self.tensor), ax=ax)


@arguments.accepts(solution=arguments.a(Solution))
def expansion(solution: Solution, *, hubble: float = 70.0) -> Shear:
    """The expansion that differs from axis to axis behind a fit of motions: µ = Σ r − (rᵀ Σ r) r.

    Parameters
    ----------
    solution : Solution
        To degree 2 at least. Its errors are taken as they are, of a robust fit where some are wrong; of a fit with a
        floor or another prior it is the fit without, for a prior would shrink what is sought. Systematic errors are
        not in these errors: the toroidal part of degree 2 is no expansion, and as large only if neither is one.
    hubble : float
        To which rates are compared. [km/s/Mpc]

    Raises
    ------
    ModesError
        If the solution has no degree 2.

    Notes
    -----
    Quercellini et al. (2009, PRL 102, 151302), Fontanini et al. (2009); Darling (2014, MNRAS 442, L66) found less than
    7 % of H0.
    """
    spheroidal_degree_two(solution.modes)
    coefficients, coefficient_covariance = solution.of_degree("S", 2)
    components, tensor_covariance = TO_TENSOR @ coefficients, TO_TENSOR @ coefficient_covariance @ TO_TENSOR.T
    return Shear(
        tensor=make_symmetric_tensor(components),
        covariance=(tensor_covariance + tensor_covariance.T) / 2,
        p_value=solution.p_value("S", 2),
        hubble=positive("hubble", hubble),
        frame=solution.frame,
        n_data=solution.n_data,
        notes=solution.notes,
    )


def _mask_own_modes(modes: Modes) -> BoolArray:
    """Mask degree 1 and the spheroidal coefficients of degree 2: what each class has for itself."""
    mask = np.array(modes.degrees == 1)
    mask[spheroidal_degree_two(modes)] = True
    return mask


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ShearByClass(Result):
    """The expansion that differs from axis to axis in classes of sources, with their common systematic errors.

    Attributes
    ----------
    labels : tuple of str
        The classes.
    places : (K,) array
        Where each class stands: the mean redshift, say.
    means, covariances : (s, K, 6) and (s, K, 6, K, 6) arrays
        Σ_xx, Σ_yy, Σ_zz, Σ_xy, Σ_xz, Σ_yz for draws of equal weight of the systematic errors. [µas/yr, (µas/yr)²]
    formal : (K,) array
        p-value of each class if its errors were those of the catalogue alone.
    n_sources : tuple of int
    hubble : float
        To which rates are compared. [km/s/Mpc]
    frame : str
    notes : tuple of str
    """

    labels: tuple[str, ...]
    places: FloatArray
    means: FloatArray
    covariances: FloatArray
    formal: FloatArray
    n_sources: tuple[int, ...]
    hubble: float
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.labels)

    def __repr__(self) -> str:
        return f"<ShearByClass: {len(self)} classes, p of equal ones {format_p_value(self.equality())}>"

    @cached_property
    def shears(self) -> tuple[Shear, ...]:
        """The tensor of each class, its errors with the systematic ones."""
        values, tensor_covariance = self.means.mean(0), pool_draw_covariances(self.means, self.covariances)
        return tuple(
            Shear(
                tensor=make_symmetric_tensor(values[i]),
                covariance=tensor_covariance[i, :, i],
                p_value=self.p_value(i),
                hubble=self.hubble,
                frame=self.frame,
                n_data=2 * self.n_sources[i],
            )
            for i in range(len(self))
        )

    def p_value(self, i: int) -> float:
        """Probability that a class without an expansion shows one as large, the mean over the systematic errors.

        Parameters
        ----------
        i : int
            Number of the class.
        """
        return self._compute_contrast_p_value(np.eye(len(self))[[i]])

    def equality(self) -> float:
        """p-value of classes that all have one tensor."""
        return self._compute_contrast_p_value(np.diff(np.eye(len(self)), axis=0))

    def growth(self) -> float:
        """p-value of a tensor that does not change linearly with the places of the classes."""
        return self._compute_contrast_p_value(self._slope_weights[None]) if len(self) > 1 else np.nan

    def _compute_contrast_p_value(self, contrasts):
        """The mean over draws of the p-value that linear combinations of classes, (r, K), are zero."""
        if not len(contrasts):
            return np.nan
        five = list(_INDEPENDENT_COMPONENTS)
        return compute_contrast_p_value(self.means[:, :, five], self.covariances[:, :, five][..., five], contrasts)

    @property
    def slope(self) -> FloatArray:
        """Change of the tensor with the places, by weighted least squares, (3, 3). [µas/yr per unit of the places]"""
        return make_symmetric_tensor(self._slope_weights @ self.means.mean(0))

    @cached_property
    def _slope_weights(self):
        """Coefficients of the classes in the slope, (K,): each class is weighted by its mean variance."""
        weights = 1 / np.einsum("nkaka->k", self.covariances)
        offsets = self.places - weights @ self.places / weights.sum()
        return weights * offsets / (weights @ offsets**2)

    def _sections(self, long):
        facts = [("classes", f"{len(self)}, {self.frame} axes; systematic errors from degree 2 (toroidal) and higher")]
        if len(self) > 1:
            facts += [
                ("equal tensors", f"p = {format_p_value(self.equality())}"),
                ("linear change", f"p = {format_p_value(self.growth())}"),
            ]
        title = "Expansion that differs from axis to axis, by class"
        return (Section(title, facts, self.to_table(), notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each class, as an astropy Table: |Σ|, limit, p-values, and the axis of the fastest expansion."""
        column_names, rows = "class place n_sources norm limit_95 p_value p_value_formal rate rate_error l b", []
        for label, place, n, shear, formal in zip(
            self.labels, self.places, self.n_sources, self.shears, self.formal, strict=True
        ):
            lon, lat = np.degrees(angles(rotation_matrix(self.frame, "galactic") @ shear.axes[0]))
            rate = (shear.eigenvalues[0], shear.eigenvalue_errors[0])
            rows.append((label, place, n, shear.norm, shear.limit(), shear.p_value, formal, *rate, lon % 360, lat))
        units = dict.fromkeys(("norm", "limit_95", "rate", "rate_error"), "uas / yr") | {"l": "deg", "b": "deg"}
        return tables.table_of_rows(column_names.split(), rows, self._plain_facts(), units)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """|Σ| of the classes with limits, and what systematic errors alone would show, on matplotlib axes."""
        from fit.motions.figures import plot_shear_by_class

        return plot_shear_by_class(self, ax=ax)


#: Five components that determine a traceless tensor.
_INDEPENDENT_COMPONENTS = (0, 1, 3, 4, 5)


def compare_expansions(
    normals: Sequence[NormalEquations],
    places: ArrayLike | None = None,
    *,
    degrees: Iterable[int] | None = None,
    labels: Sequence[str] | None = None,
    hubble: float = 70.0,
    own: str = "each",
    draws: int = 400,
    noise_scale: bool | None = None,
    rng: Rng = 1,
) -> ShearByClass:
    """The expansion that differs from axis to axis in classes of sources: bins of redshift, with systematic errors.

    Parameters
    ----------
    normals : sequence of NormalEquations
        One a class, all to degree 3 at least (5 is best), in one frame; no source in two of them.
    places : (K,) numbers, optional
        Where each class stands, for the test of growth: its mean redshift; 0, 1, 2, … unless given.
    degrees : iterable of int, optional
        Those that systematic errors are estimated from, 2, 3, … without a gap; all that are fitted unless given.
    labels : sequence of str, optional
        Names of the classes.
    hubble : float
        To which rates are compared. [km/s/Mpc]
    own : {"each", "one"}
        Whether the systematic errors that are specific to each class have a power for each, or one for all, as
        `fit.background.shared` has. "one" is more sensitive, and wrong if one class is worse than the others.
    draws : int
        Draws of the systematic errors for each shape of their spectrum.
    noise_scale : bool, optional
        Whether the errors of each class are scaled by its own χ²/dof, as `fit.background.shared` does.
    rng : Generator or int
        The source of all randomness.

    Returns
    -------
    ShearByClass
        Tensors, and p-values of each, of equal tensors, and of growth.

    Raises
    ------
    ParameterError
        If there is not one place a class, or they are all the same.
    ModesError, FrameError, DegeneracyError
        As `fit.background.shared`.

    Notes
    -----
    Systematic errors are estimated from the toroidal coefficients of degree 2 and all coefficients of higher degrees,
    and have as much power in the five that the expansion has. Without them p-values of Gaia's quasars are far too
    small: its published systematic errors have power in every degree. Makarov, Heinesen & Schücker (2026,
    arXiv:2605.30579) fit five bins of redshift without them. Coverage: docs/validation.md.

    Examples
    --------
    >>> from fit import normal_equations
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 4000), np.arcsin(rng.uniform(-1, 1, 4000))
    >>> field = Field(lon, lat, rng.normal(size=(2, 4000)), np.ones((2, 4000)))
    >>> bins = [normal_equations(field[:2000], 4), normal_equations(field[2000:], 4)]
    >>> bool(compare_expansions(bins, [0.5, 1.5], draws=100).growth() > 0.01)
    True
    """
    random = generator(rng)
    class_draws, modes, notes, facts = sample_class_errors(
        normals, degrees, labels=labels, shapes=None, own=own, draws=draws, noise_scale=noise_scale, rng=random,
        free=_mask_own_modes,
    )  # fmt: skip
    n_classes = len(facts["labels"])
    places = np.arange(n_classes, dtype=float) if places is None else float_array("places", places, (n_classes,))
    if n_classes > 1 and not np.ptp(places) > 0:
        raise ParameterError(f"a test of growth needs a place for each of {n_classes} classes, not all the same")
    means, covariances = resample_draws(class_draws, random)[:2]
    terms = np.flatnonzero(_mask_own_modes(modes)).searchsorted(np.arange(len(modes))[spheroidal_degree_two(modes)])
    tensors = np.einsum("ab,nkb->nka", TO_TENSOR, means[:, :, terms])
    tensor_covariances = np.einsum("ab,nibjc,dc->niajd", TO_TENSOR, covariances[:, :, terms][..., terms], TO_TENSOR)
    formal = [expansion(solve(normal)).p_value for normal in normals]
    return ShearByClass(
        labels=facts["labels"], places=places, means=tensors, covariances=tensor_covariances, formal=np.array(formal),
        n_sources=facts["n_sources"], hubble=positive("hubble", hubble), frame=facts["frame"], notes=tuple(notes),
    )  # fmt: skip
