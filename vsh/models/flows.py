"""Flows of galaxies in linear theory: how their velocities are correlated, as modes, and on grids.

Distances are in Mpc/h, so that they follow from redshifts whatever the Hubble constant; velocities are in km/s, in the
frame of the microwave background.

Velocities in linear theory: one Gaussian field, whose power follows from that of matter.

The velocity is the gradient of a potential, v(k) = i f H δ(k) k/k², with f the growth rate. In units of h the Hubble
constant is 100 km/s per Mpc/h. Velocities at a separation r are correlated by Ψ∥ along r and Ψ⊥ across it (Górski 1988,
ApJ 332, L7):

    Ψ⊥(r) = (f H)²/(2π²) ∫ P(k) j₁(kr)/(kr) dk,   Ψ∥(r) = (f H)²/(2π²) ∫ P(k) [j₀(kr) − 2 j₁(kr)/(kr)] dk.

Flows as a sum of a few hundred modes with independent amplitudes: harmonics on the sky times functions of distance.

A potential flow of wave number k is

    v_⊥ = √(l(l+1)) j_l(kr)/r S_lm,   v_r = k j_l'(kr) Y_lm,

with amplitudes of variance (2/π) (f H)² P(k)/k² dk: it has no toroidal part. For every degree a singular value
decomposition of these functions of distance, tangential and radial ones together, leaves the few that matter. The
amplitude of a mode is one on average.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy.special import spherical_jn

from vsh.basis import scalar_harmonics, spheroidal_twin, toroidal_harmonics
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.pixels import check_nside, pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.arguments import float_array, positive
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.files import check_overwrite_allowed, write_arrays
from vsh.tools.notebook import Frozen, InNotebook
from vsh.tools.printing import printable
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, PathName

__all__ = [
    "LINEAR_PLANCK18", "FlowModes", "LinearTheory", "VelocityGrid", "flow_modes", "flow_of_galaxies",
    "read_velocity_grid",
]  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class VelocityGrid(InNotebook):
    """Velocities on a cube around us.

    Attributes
    ----------
    velocity : (3, k, k, k) array
        Components along the axes of `frame`, at points from −half_width to +half_width on each axis. [km/s, in the
        frame of the microwave background]
    half_width : float
        [Mpc/h]
    frame : str
        Frame of the axes.

    Raises
    ------
    ParameterError
        If it is no cube of finite numbers.
    """

    velocity: FloatArray
    half_width: float
    frame: str = "galactic"

    def __post_init__(self) -> None:
        velocity = np.asarray(self.velocity)
        size = velocity.shape[-1] if velocity.ndim == 4 else 0
        if size < 2 or velocity.shape != (3, size, size, size):
            raise ParameterError(
                f"a grid of velocities has shape (3, k, k, k), not {velocity.shape}: components, then x, y and z"
            )
        if velocity.dtype.kind not in "fiu" or not np.isfinite(velocity).all():
            raise ParameterError("a grid of velocities holds finite numbers, in km/s")
        check_frame(self.frame)
        object.__setattr__(self, "velocity", velocity)
        object.__setattr__(self, "half_width", arguments.positive("half_width", self.half_width))

    def __repr__(self) -> str:
        return f"<VelocityGrid: {self.velocity.shape[-1]}³ points to ±{self.half_width:g} Mpc/h, {self.frame}>"

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray, frame: str) -> tuple[FloatArray, BoolArray]:
        """The velocity between the points, by threes of linear interpolations, along the axes of `frame`.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions in `frame`. [rad]
        distance : (n,) array
            [Mpc/h]
        frame : str
            Axes of the positions and of the result.

        Returns
        -------
        velocity : (3, n) array
            [km/s]; zero outside the cube.
        inside : (n,) mask
            Which sources are within the cube.
        """
        from scipy.ndimage import map_coordinates  # slow to import

        rotation = rotation_matrix(frame, self.frame)
        positions = rotation @ triad(lon, lat)[2] * np.asarray(distance, float)
        inside = (np.abs(positions) <= self.half_width).all(0)
        size = self.velocity.shape[-1]
        grid_indices = (positions + self.half_width) * ((size - 1) / (2 * self.half_width))
        components = np.stack(
            [map_coordinates(component, grid_indices, order=1, cval=0.0, output=float) for component in self.velocity]
        )
        return rotation.T @ np.where(inside, components, 0.0), inside

    def write(self, path: PathName, *, overwrite: bool = False) -> None:
        """Write it as a file of NumPy, `path` ending in .npz, which `read_velocity_grid` reads.

        Parameters
        ----------
        path : str or Path
            The file.
        overwrite : bool
            Whether a file that is there is replaced.
        """
        check_overwrite_allowed(path, overwrite)
        arrays = {"velocity": self.velocity, "half_width": self.half_width, "frame": np.array(self.frame)}
        write_arrays(path, arrays, compress=True, overwrite=overwrite)


def read_velocity_grid(path: PathName, half_width: float | None = None, frame: str | None = None) -> VelocityGrid:
    """Read velocities on a grid.

    Parameters
    ----------
    path : str or Path
        .npz as `VelocityGrid.write` writes it; or .npy, an array (3, k, k, k) as that of 2M++ (Carrick et al. 2015,
        MNRAS 450, 317), which is in Galactic axes to ±200 Mpc/h.
    half_width : float, optional
        Half width of the cube: the file's own, or 200 Mpc/h of an .npy file.
    frame : str, optional
        Frame of the axes: the file's own, or Galactic of an .npy file.

    Raises
    ------
    TableError
        If the file cannot be read or holds no such grid.
    """
    label = printable(path)
    try:
        cube = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise TableError(f"{label} cannot be read as a grid of velocities (.npz or .npy of NumPy): {error}") from None
    if isinstance(cube, np.ndarray):
        velocity, own_width, own_frame = cube, 200.0, "galactic"
    else:
        with cube:
            missing = {"velocity", "half_width", "frame"} - set(cube.files)
            if missing:
                raise TableError(f"{label} lacks {', '.join(sorted(missing))}: it is no grid of velocities")
            velocity, own_width, own_frame = cube["velocity"], float(cube["half_width"]), str(cube["frame"])
    try:
        return VelocityGrid(velocity, half_width or own_width, frame or own_frame)
    except ParameterError as error:
        raise TableError(f"{label}: {error}") from None


#: The Hubble constant where distances are in Mpc/h. [km/s per Mpc/h]
HUBBLE = 100.0
#: Separations beyond which velocities are taken as independent. [Mpc/h]
_FARTHEST = 3000.0


@dataclass(frozen=True, eq=False, repr=False)
class LinearTheory(Frozen):
    """A power spectrum of matter today and the rate at which structures grow.

    Attributes
    ----------
    k : (n,) array
        Wave numbers, rising. [h/Mpc]
    power : (n,) array
        P(k). [(Mpc/h)³]
    growth_rate : float
        f = d ln D/d ln a today; Ω_m^0.55 in general relativity.
    name : str
        For reports.

    Raises
    ------
    ParameterError
        If wave numbers do not rise from above zero, or a power is not above zero.
    """

    k: FloatArray
    power: FloatArray
    growth_rate: float
    name: str = "linear theory"

    def __post_init__(self) -> None:
        k, power = float_array("k", self.k), float_array("power", self.power)
        if k.ndim != 1 or k.shape != power.shape or k.size < 8 or not (k[0] > 0 and (np.diff(k) > 0).all()):
            raise ParameterError("a power spectrum is two arrays of one length, at least eight; k rises from above 0")
        if not (power > 0).all():
            raise ParameterError("the power of matter is above zero at every wave number")
        self._set_frozen(k=k, power=power, growth_rate=positive("growth_rate", self.growth_rate))

    def __repr__(self) -> str:
        return f"<LinearTheory: {self.name}, {self.sigma:.0f} km/s in each component>"

    def power_at(self, k: ArrayLike) -> FloatArray:
        """P(`k`) between the tabulated wave numbers [h/Mpc]; nothing beyond them. [(Mpc/h)³]"""
        k = np.asarray(k, float)
        inside = (k >= self.k[0]) & (k <= self.k[-1])
        return np.where(inside, np.exp(self._log_power_spline(np.log(np.clip(k, self.k[0], self.k[-1])))), 0.0)

    @property
    def sigma(self) -> float:
        """The dispersion of velocities in each component. [km/s]"""
        return float(np.sqrt(self._correlation_spline_and_table[1][0, 0]))

    def correlation(self, separation: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Ψ∥ and Ψ⊥, the correlations of velocities along a `separation` [Mpc/h] and across it. [(km/s)²]"""
        separation = np.asarray(separation, float)
        in_range = separation < _FARTHEST
        x = np.arcsinh(np.minimum(separation, _FARTHEST))
        psi_along, psi_across = np.moveaxis(self._correlation_spline_and_table[0](x), -1, 0)
        return np.where(in_range, psi_along, 0.0), np.where(in_range, psi_across, 0.0)

    def covariance(self, positions: FloatArray) -> FloatArray:
        """The covariance of velocities at `positions` (3, n) [Mpc/h], (3n, 3n): x, y, z of the first, … [(km/s)²]"""
        n = positions.shape[1]
        separations = positions[:, :, None] - positions[:, None, :]
        r = np.sqrt(np.sum(separations * separations, 0))
        along, across = self.correlation(r)
        direction = separations / np.maximum(r, 1e-12)
        matrix = np.empty((n, 3, n, 3))
        for i in range(3):
            for j in range(3):
                matrix[:, i, :, j] = (along - across) * direction[i] * direction[j] + (across if i == j else 0.0)
        return matrix.reshape(3 * n, 3 * n)

    @cached_property
    def _log_power_spline(self):
        return _fit_cubic_spline(np.log(self.k), np.log(self.power))

    @cached_property
    def _correlation_spline_and_table(self):
        """Ψ∥ and Ψ⊥ as a spline in arsinh r, and as a table."""
        # Wave numbers close enough for sums, and their step in ln k.
        log_k, step = np.linspace(np.log(self.k[0]), np.log(self.k[-1]), 6001, retstep=True)
        k = np.exp(log_k)
        k_weight = (self.growth_rate * HUBBLE) ** 2 / (2 * np.pi**2) * self.power_at(k) * k * step
        x = np.linspace(0, np.arcsinh(_FARTHEST), 500)
        psi_table = np.empty((len(x), 2))
        for i, r in enumerate(np.sinh(x)):
            # j_0(x) and j_1(x)/x, three times as fast as the library's by recurrence.
            kr = np.maximum(k * r, 1e-6)
            kr2, j0 = kr * kr, np.sin(kr) / kr
            j1_by_kr = np.where(kr < 0.02, 1 / 3 - kr2 / 30 + kr2**2 / 840, (j0 - np.cos(kr)) / kr2)
            psi_table[i] = k_weight @ (j0 - 2 * j1_by_kr), k_weight @ j1_by_kr
        return _fit_cubic_spline(x, psi_table), psi_table


def _fit_cubic_spline(x, y):
    """Fit a cubic spline through what is tabulated."""
    from scipy.interpolate import make_interp_spline  # slow to import

    return make_interp_spline(x, y)


_K, _POWER = np.loadtxt(Path(__file__).with_name("planck2018_power.txt"), unpack=True)
#: Flat, Ω_m = 0.3111, σ_8 = 0.8102: Planck Collaboration (2020, A&A 641, A6), with f = Ω_m^0.55.
LINEAR_PLANCK18 = LinearTheory(_K, _POWER, 0.3111**0.55, "linear ΛCDM, Planck 2018")
#: Shells in which the density of galaxies is counted, and how far beyond the farthest the cube goes.
_N_SHELLS, _MARGIN = 16, 1.6


def flow_of_galaxies(
    lon: ArrayLike,
    lat: ArrayLike,
    distance: ArrayLike,
    *,
    beta: float = LINEAR_PLANCK18.growth_rate,
    smoothing: float = 8.0,
    size: int = 96,
    visible: ArrayLike | None = None,
    frame: str = "icrs",
) -> VelocityGrid:
    """Reconstruct the flow that linear theory has for the density of galaxies.

    Parameters
    ----------
    lon, lat : (n,) arrays
        Positions in `frame`. [rad]
    distance : (n,) array
        [Mpc/h]
    beta : float
        f/b: the growth rate over the bias of the galaxies.
    smoothing : float
        Standard deviation of the Gaussian that the density is smoothed with; at 8 Mpc/h velocities are right on
        average, with less they are too large, because the density is no longer linear. [Mpc/h]
    size : int
        Points of the grid along each axis; cells are at most as wide as the smoothing.
    visible : (12 nside²,) bool array, optional
        Where galaxies could be seen, a HEALPix map in ring order; elsewhere the density is taken as the mean. The whole
        sky unless given.
    frame : str
        Frame of the positions and of the grid.

    Returns
    -------
    VelocityGrid
        Zero on average; beyond the farthest galaxy the density is taken as the mean, so that a uniform flow by what is
        farther away is missing.

    Raises
    ------
    ParameterError
        If there are fewer than a hundred galaxies, a distance is not above zero, or the cells are too wide.

    Notes
    -----
    v = −β H ∇ ∇⁻² δ with δ the density of galaxies over its mean at their distance, less one. The mean is a cubic in
    distance that is fitted to the logarithm of counts in shells.
    """
    lon = arguments.array_with_dimensions(1)("lon", lon)
    lat = float_array("lat", lat, lon.shape)
    distance = float_array("distance in Mpc/h", distance, lon.shape)  # not that of other functions, so without a unit
    beta, smoothing, size = positive("beta", beta), positive("smoothing", smoothing), arguments.whole("size", size, 8)
    if len(lon) < 100 or not (distance > 0).all():
        raise ParameterError(f"a density takes a hundred galaxies with distances above zero, not {len(lon)}")
    farthest = float(distance.max())
    half_width = _MARGIN * farthest
    step = 2 * half_width / size
    if step > smoothing:
        fewest_points = int(np.ceil(2 * half_width / smoothing))
        raise ParameterError(f"cells of {step:.2g} Mpc/h are wider than the smoothing: take a size of {fewest_points}")
    cell_edges = np.linspace(-half_width, half_width, size + 1)
    counts, _ = np.histogramdd((triad(lon, lat)[2] * distance).T, bins=(cell_edges,) * 3)
    cell_centres = (cell_edges[1:] + cell_edges[:-1]) / 2
    cells = np.stack(np.meshgrid(cell_centres, cell_centres, cell_centres, indexing="ij"))
    cell_radius = np.sqrt(np.sum(cells**2, 0))
    is_seen, visible_share = cell_radius < farthest, 1.0
    if visible is not None:
        visible = np.asarray(visible, bool)
        nside = check_nside(round(np.sqrt(visible.size / 12)))
        if visible.shape != (12 * nside**2,):
            raise ParameterError(f"visible is a HEALPix map, of 12 nside² pixels, not of shape {visible.shape}")
        is_seen &= visible[pixels_of(*angles(cells.reshape(3, -1)), nside)].reshape(cell_radius.shape)
        visible_share = float(visible.mean())
        distance = distance[visible[pixels_of(lon, lat, nside)]]
    shells = farthest * np.linspace(0, 1, _N_SHELLS + 1) ** (1 / 3)
    volume = 4 / 3 * np.pi * visible_share * np.diff(shells**3)
    centres = ((shells[1:] ** 3 + shells[:-1] ** 3) / 2) ** (1 / 3)
    density = np.histogram(distance, shells)[0] / volume
    is_filled = density > 0
    cubic = np.polyfit(centres[is_filled], np.log(density[is_filled]), 3, w=np.sqrt((density * volume)[is_filled]))
    mean_counts = np.exp(np.polyval(cubic, np.clip(cell_radius, centres[0], centres[-1]))) * step**3
    contrast = np.where(is_seen, counts / mean_counts - 1, 0.0)
    contrast[is_seen] -= contrast[is_seen].mean()
    k = make_wave_vectors(size, step)
    smoothed_transform = np.fft.rfftn(contrast) * np.exp(-np.sum(k**2, 0) * smoothing**2 / 2)
    return VelocityGrid(compute_linear_velocities(smoothed_transform, k, beta), half_width - step / 2, frame)


def make_wave_vectors(size: int, step: float) -> FloatArray:
    """Wave vectors of the Fourier transform of a real field on a cube of `size`³ cells, (3, size, size, size/2 + 1)."""
    wave_numbers = 2 * np.pi * np.fft.fftfreq(size, step)
    return np.stack(np.meshgrid(wave_numbers, wave_numbers, np.abs(wave_numbers[: size // 2 + 1]), indexing="ij"))


def compute_linear_velocities(contrast_transform: FloatArray, k: FloatArray, beta: float) -> FloatArray:
    """Compute velocities of linear theory on a cube, (3, size, size, size), v(k) = i β H δ(k) k/k². [km/s]"""
    k_squared = np.sum(k**2, 0)
    k_squared[0, 0, 0] = 1.0  # a uniform density pulls nowhere
    pull_factor, grid_shape = 1j * beta * HUBBLE * contrast_transform / k_squared, (k.shape[1],) * 3
    return np.stack([np.fft.irfftn(pull_factor * component, grid_shape, axes=(0, 1, 2)) for component in k])


#: Beyond this distance flows move nobody's estimate: sources there have independent velocities. [Mpc/h]
FARTHEST = 600.0
#: Below this distance the modes are as here. [Mpc/h]
_NEAREST = 2.0
_N_RADII = 160


@dataclass(frozen=True, eq=False, repr=False)
class FlowModes(Frozen):
    """The modes of a flow between two distances, each with an amplitude of one on average.

    Attributes
    ----------
    theory : LinearTheory
    counts : tuple of int
        How many functions of distance there are of each degree from 0 on; degree l has 2l + 1 modes of each.
    radii : (k,) array
        Where the functions are tabulated. [Mpc/h]
    tangential, radial : (k, f) arrays
        The functions, degree by degree. [km/s]
    origin : (f,) array
        The radial ones at distance zero: those of degree 1 alone differ from zero. [km/s]
    """

    theory: LinearTheory
    counts: tuple[int, ...]
    radii: FloatArray
    tangential: FloatArray
    radial: FloatArray
    origin: FloatArray

    def __len__(self) -> int:
        return sum((2 * l + 1) * count for l, count in enumerate(self.counts))

    def __repr__(self) -> str:
        return (
            f"<FlowModes: {len(self)} to degree {len(self.counts) - 1}, {self.radii[0]:.3g} to {self.radii[-1]:.3g} "
            "Mpc/h>"
        )

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities of sources by each mode.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        distance : (n,) array
            [Mpc/h]

        Returns
        -------
        tangential : (2, n, p) array
            East and north. [km/s]
        radial : (n, p) array
            Outwards. [km/s]
        """
        tangential, radial = self._interpolate_functions(np.asarray(distance, float))
        return self._compute_mode_velocities(np.asarray(lon, float), np.asarray(lat, float), tangential, radial)

    def at_origin(self) -> FloatArray:
        """Velocity where we are by each mode, (3, p), along the axes of the positions. [km/s]"""
        lon, lat = np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, 0.0, np.pi / 2])  # along x, y and z
        functions = np.broadcast_to(self.origin, (3, self.origin.size))
        return self._compute_mode_velocities(lon, lat, np.zeros_like(functions), functions)[1]

    def left(self, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The variance of velocities that the modes leave, in each tangential component and in the radial one.

        Parameters
        ----------
        distance : (n,) array
            [Mpc/h]

        Returns
        -------
        tuple[array, array]
            [(km/s)²]
        """
        tangential, radial = self._interpolate_functions(np.asarray(distance, float))
        l = np.repeat(np.arange(len(self.counts)), self.counts)
        share = (2 * l + 1) / (4 * np.pi)  # Σ_m |S_lm|² = Σ_m |Y_lm|²
        total = self.theory.sigma**2
        return np.maximum(total - tangential**2 @ share / 2, 0.0), np.maximum(total - radial**2 @ share, 0.0)

    @cached_property
    def _function_spline(self):
        return _fit_cubic_spline(np.log(self.radii), np.hstack([self.tangential, self.radial]))

    @cached_property
    def _tangential_spline(self):
        return _fit_cubic_spline(np.log(self.radii), self.tangential)

    def _interpolate_functions(self, distance):
        """Interpolate the functions of distance at sources: two (n, f) arrays; zero beyond the last radius."""
        return np.split(self._interpolate_spline(self._function_spline, distance), 2, axis=1)

    def _interpolate_spline(self, spline, distance):
        values = spline(np.log(np.clip(distance, self.radii[0], self.radii[-1])))
        values[distance > self.radii[-1] * (1 + 1e-9)] = 0.0
        return values

    def columns(self, lon: FloatArray, lat: FloatArray, distance: FloatArray, turn: FloatArray) -> FloatArray:
        """The tangential velocities of `at` along other axes: what a fit has in its rows.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        distance : (n,) array
            [Mpc/h]
        turn : (2, 2, n) array
            From east and north to those axes.

        Returns
        -------
        (p, 2, n) array
            [km/s, times `turn`]
        """
        tangential = self._interpolate_spline(self._tangential_spline, np.asarray(distance, float))
        toroidal = toroidal_harmonics(lon, lat, max(len(self.counts) - 1, 1))
        harmonics = np.empty_like(toroidal)
        for axis in range(2):  # S is (−n, e) of T
            np.multiply(toroidal[:, 0], turn[axis, 1], out=harmonics[:, axis])
            harmonics[:, axis] -= turn[axis, 0] * toroidal[:, 1]
        return self._make_modes(harmonics, tangential, 1)

    def _compute_mode_velocities(self, lon, lat, tangential, radial):
        """Compute functions of distance times harmonics, normalised to one over the sphere."""
        lmax = len(self.counts) - 1
        y = scalar_harmonics(lon, lat, lmax)
        s = spheroidal_twin(toroidal_harmonics(lon, lat, max(lmax, 1)))
        return self._make_modes(s, tangential, 1).transpose(1, 2, 0), self._make_modes(y[:, None], radial, 0)[:, 0].T

    def _make_modes(self, harmonics, functions, lowest):
        """Multiply harmonics from a lowest degree on, (m, c, n), by functions of distance, (n, f): modes, (p, c, n)."""
        modes = np.empty((len(self), *harmonics.shape[1:]))
        mode_start = function_start = 0
        functions = functions.T
        for l, count in enumerate(self.counts):
            mode_view = modes[mode_start : mode_start + (2 * l + 1) * count].reshape(2 * l + 1, count, *modes.shape[1:])
            if l < lowest:
                mode_view[:] = 0.0
            else:
                degree_harmonics = harmonics[l * l - lowest : (l + 1) ** 2 - lowest, None]
                degree_functions = functions[function_start : function_start + count, None]
                np.multiply(degree_harmonics[0], degree_functions, out=mode_view[0])
                # A real field has m ≥ 0 alone, each counted twice.
                np.multiply(degree_harmonics[1:], degree_functions / np.sqrt(2), out=mode_view[1:])
            mode_start, function_start = mode_start + (2 * l + 1) * count, function_start + count
        return modes


@arguments.accepts(
    nearest=arguments.not_negative,
    farthest=arguments.positive,
    n_modes=arguments.whole,
    theory=arguments.a(LinearTheory),
    max_degree=arguments.whole,
)
def flow_modes(
    nearest: float, farthest: float, n_modes: int = 250, theory: LinearTheory = LINEAR_PLANCK18, *, max_degree: int = 60
) -> FlowModes:
    """Return the modes that carry most of the power of linear flows between two distances.

    Parameters
    ----------
    nearest, farthest : float
        Limits of the distances. Sources beyond 600 Mpc/h count as having independent peculiar velocities. [Mpc/h]
    n_modes : int
        The largest number of modes; perhaps fewer, as a radial function has all 2l + 1 orders of its degree.
    theory : LinearTheory
        Power spectrum of matter and growth rate (default: Planck 2018).
    max_degree : int
        The highest degree considered.

    Raises
    ------
    ParameterError
        If `farthest` does not exceed `nearest`, `nearest` is beyond 600 Mpc/h, or `n_modes` is less than three.

    Notes
    -----
    The first three modes are the bulk flow, the first function of degree 1. For 500 galaxies between 6 and 90 Mpc/h,
    the covariance from 250, 500 and 1000 modes differs from the exact one by 3, 2 and 1 % in Frobenius norm.
    """
    if not nearest < farthest:
        raise ParameterError(f"farthest ({farthest:g} Mpc/h) must exceed nearest ({nearest:g} Mpc/h)")
    if not nearest < FARTHEST:
        raise ParameterError(f"nearest must be below {FARTHEST:g} Mpc/h, not {nearest:g}")
    if n_modes < 3:
        raise ParameterError(f"n_modes must be at least 3, not {n_modes}: the first three are the bulk flow")
    nearest, farthest = max(nearest, _NEAREST), min(max(farthest, 1.5 * _NEAREST), FARTHEST)
    return _choose_strongest_modes(nearest, farthest, n_modes, theory, max_degree)


@lru_cache(maxsize=64)  # reused for many realisations of the same sources
def _choose_strongest_modes(nearest, farthest, n_modes, theory, max_degree):
    radii = np.geomspace(nearest, farthest, _N_RADII)
    k, step = _make_wave_numbers_and_steps(farthest)
    amplitude = theory.growth_rate * HUBBLE * np.sqrt(2 / np.pi * theory.power_at(k) * step) / k
    radial_weight = np.sqrt(np.gradient(radii)) * radii
    radial_weight /= np.sqrt(np.sum(radial_weight**2))
    kr = np.outer(radii, k)
    powers, functions = [], []
    bessel = spherical_jn(0, kr)
    slope = -spherical_jn(1, kr)
    for l in range(max_degree + 1):
        if l:
            previous_bessel, bessel = bessel, spherical_jn(l, kr)
            slope = previous_bessel - (l + 1) / kr * bessel
        tangential = np.sqrt(l * (l + 1)) * bessel / radii[:, None] * amplitude
        radial = slope * k * amplitude
        weighted_matrix = np.vstack([tangential, radial]) * np.tile(radial_weight, 2)[:, None]
        _, singular_values, right_vectors = np.linalg.svd(weighted_matrix, full_matrices=False)
        origin = k / 3 * amplitude if l == 1 else np.zeros_like(k)
        leading_vectors = right_vectors[: n_modes // (2 * l + 1) + 1].T
        powers.append(singular_values[: leading_vectors.shape[1]] ** 2)
        functions.append((tangential @ leading_vectors, radial @ leading_vectors, origin @ leading_vectors))
        # No function of a higher degree has more power than the first of this one: the selection is complete.
        if l > 1 and sum((2 * k + 1) * np.sum(power > powers[l][0]) for k, power in enumerate(powers)) >= n_modes:
            break
    power, degree = np.concatenate(powers), np.repeat(np.arange(len(powers)), list(map(len, powers)))
    order = np.argsort(-power, kind="stable")
    bulk_index = order[degree[order] == 1][0]
    order = np.r_[bulk_index, order[order != bulk_index]]
    order = order[np.cumsum(2 * degree[order] + 1) <= n_modes]
    selection = order[np.lexsort([-power[order], degree[order]])]
    selected = (np.concatenate(columns, axis=-1)[..., selection] for columns in zip(*functions, strict=True))
    return FlowModes(theory, tuple(np.bincount(degree[selection]).tolist()), radii, *selected)


def _make_wave_numbers_and_steps(farthest, highest=0.6):
    """Make wave numbers and the step at each: even in ln k where k is small, fine enough for the largest distance."""
    low = np.geomspace(2e-4, 0.02, 40)
    edges = np.sqrt(low[1:] * low[:-1])
    step = min(0.004, 0.6 / farthest)
    high = np.arange(0.02 + step / 2, highest, step)
    return np.r_[low, high], np.r_[np.diff(np.r_[low[0] ** 2 / edges[0], edges, 0.02]), np.full(high.size, step)]
