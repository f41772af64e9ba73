"""What an attitude that was solved from the same sky takes of motions that change with time.

The joint solution of sources and attitude leaves (1 − P) s of a field s, P the projection on both. Who has epochs of it
and takes out five parameters a source is left with the same, where from each template is taken what the attitude took
of it. Along the scan that is the weighted mean of what both fields of view show,

    a(t) = [w_P m·(s − x)_P + w_F m·(s − x)_F] / (w_P + w_F),

x what the five parameters of stars there take up, found from the differences of the two fields alone:

    min_x Σ_t W [m·(s − x)_P − m·(s − x)_F]²,   W = w_P w_F / (w_P + w_F),

five numbers for each pixel of the sky. It needs the scanning law, not the attitude's own unknowns.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix, hstack

from sim.agis._calibration import Calibration, find_nearest_views
from sim.scanning import NominalScanningLaw, TabulatedLaw, is_outside_gaps
from vsh.basis import harmonics
from vsh.modes import Modes
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import centres, check_nside, pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.errors import FrameError, ParameterError
from vsh.tools.files import read_arrays, write_arrays
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, FloatArray, IntArray, PathName, Rng

#: Functions of time: from years since the middle of the mission, (k,), to so many rows, (F, k).
Functions = Callable[[FloatArray], FloatArray]
#: Steps of time taken at once.
_BLOCK_STEPS = 20_000
#: 14.3 million sources (Lindegren et al. 2021, A&A 649, A2), 14 transits a year, 100 µas each. [1/µas²/yr]
INFORMATION = 14.3e6 * 14 / 100**2


class Response(InNotebook):
    """Response of the attitude of a mission to templates, factored once.

    Parameters
    ----------
    law : NominalScanningLaw or TabulatedLaw
        The scanning law, in ICRS, with the gaps of the data (`sim.find_gaps`).
    weights : (12 nside²,) array, optional
        Σ 1/σ² of the stars that hold the attitude, by pixel in ring order; even unless given, which for stars as
        crowded to the Galactic plane as 21 : 1 is better by 1 % than counts in small pixels: give a smooth density.
    nside : int
        Resolution of what the stars take up: waves keep .96 of their amplitude at 8, .97 at 12, .98 at 16. Memory and
        time of the factor: 118 MB and 1 s, .6 GB and 7 s, 1.9 GB and 33 s.
    epoch : float, optional
        Julian year of the observations' time zero; the middle of the mission unless given.
    calibration : Calibration or str, optional
        What is calibrated of the basic angle from the same observations, as "free every 5 days to order 1, known to 1
        µas"; nothing unless given. It must be known before a limit is published: these harmonics leave .02 of the
        power of a glide in time, and .6 of that of degree 2.
    information : float
        Σ 1/σ² of all transits along the scan in a year, beside which a calibration that is known to some µas is
        weighed. The default is that of 14.3 million sources, as solved EDR3's attitude, with 14 transits a year of 100
        µas. [1/µas²/yr]
    steps : int
        Times at which the fields are compared.
    rng : Generator or int
        The source of those times.

    Raises
    ------
    FrameError
        If the law is not in ICRS.
    ParameterError
        If there are not as many weights as pixels, or a calibration has another form.
    """

    def __init__(
        self,
        law: NominalScanningLaw | TabulatedLaw,
        weights: ArrayLike | None = None,
        nside: int = 12,
        *,
        epoch: float | None = None,
        calibration: Calibration | str | None = None,
        information: float = INFORMATION,
        steps: int = 600_000,
        rng: Rng = 1,
    ) -> None:
        if law.frame != "icrs":
            raise FrameError(f"observations stand in ICRS, this scanning law in {law.frame} axes")
        self.law, self.nside = law, check_nside(nside, any_size=True)
        self.epoch = law.start + law.years / 2 if epoch is None else arguments.number("epoch", epoch)
        self.weights = np.ones(12 * nside**2) if weights is None else np.asarray(weights, float)
        if self.weights.shape != (12 * nside**2,) or not (self.weights >= 0).all():
            raise ParameterError(f"weights are {12 * nside**2} numbers of at least 0, one a pixel of nside {nside}")
        self._lon, self._lat = centres(nside, any_size=True)
        time = np.sort(arguments.generator(rng).uniform(0, law.years, arguments.whole("steps", steps)))
        time = time[is_outside_gaps(time, law.lost)]
        z, *views = law.attitude(time)
        self._time = time - (self.epoch - law.start)
        self._view_axes = [(r, np.cross(z, r, axis=0)) for r in views]
        pixels = [self._find_pixels(r) for r in views]
        w_preceding, w_following = (self.weights[pixel] for pixel in pixels)
        self._difference_weights = w_preceding * w_following / np.maximum(w_preceding + w_following, 1e-300)
        columns = [5 * pixel[:, None] + np.arange(5) for pixel in pixels]
        entries = [
            sign * self._compute_parameter_partials(pixel, scan, self._time).T
            for sign, pixel, (_, scan) in zip((1, -1), pixels, self._view_axes, strict=True)
        ]
        rows = 10 * np.arange(len(time) + 1)
        shape = (len(time), 5 * len(self.weights))
        self._design = csr_matrix((np.concatenate(entries, 1).ravel(), np.concatenate(columns, 1).ravel(), rows), shape)
        self.calibration = Calibration.parse(calibration)
        self.information = arguments.positive("information", information)
        if self.calibration is not None:
            self._design = hstack([self._design, self._make_angle_columns(self._time)], format="csr")
            # Steps have the weights of stars, of no scale: that of `information` is what the prior is measured by.
            starts, ends = np.clip(np.array(law.lost, float).reshape(-1, 2).T, 0.0, law.years)
            previous_ends = np.concatenate([[0.0], np.maximum.accumulate(ends)])[:-1]  # gaps may overlap
            observed_years = law.years - float(np.sum(np.maximum(ends - np.maximum(starts, previous_ends), 0.0)))
            self._scale = self.information * observed_years / float(np.sum(w_preceding + w_following))
        self._factor: Any = None
        self._taken: dict[Any, FloatArray] = {}

    def __repr__(self) -> str:
        calibration = "" if self.calibration is None else f", basic angle {self.calibration}"
        return f"<Response: {self.law.years:g} years, nside {self.nside}{calibration}>"

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the basic angle for the results that this response enters."""
        if self.calibration is not None:
            return (f"what a basic angle calibrated from the same sky absorbs is allowed for: {self.calibration}",)
        return ("warning: no basic angle is calibrated; where one was, it absorbs more, and limits are too low",)

    def save(self, path: PathName, overwrite: bool = False) -> None:
        """Write what was factored to `path`, NPZ of 8 (60 nside²)² bytes, for `read`; `overwrite` replaces it."""
        arrays = {"factor": self._factorise_normal()[0], "weights": self.weights, "law": self._sample_law()}
        calibration = self.calibration
        numbers = () if calibration is None else (calibration.order, calibration.days, calibration.known)
        write_arrays(path, arrays | {"calibration": np.array([*numbers, self.information], float)}, overwrite=overwrite)

    @classmethod
    def read(cls, path: PathName, law: NominalScanningLaw, **options: Any) -> "Response":
        """A response whose factor was written.

        Parameters
        ----------
        path : str or Path
            What `save` wrote.
        law : NominalScanningLaw
            The law that it was factored for.
        **options
            epoch, steps and rng, as they were then.

        Raises
        ------
        ParameterError
            If they are not.
        """
        arrays = read_arrays(path)
        nside = round(np.sqrt(len(arrays["weights"]) / 12))
        *numbers, information = arrays["calibration"].tolist()
        calibration = Calibration(int(numbers[0]), *numbers[1:]) if numbers else None
        options = {"calibration": calibration, "information": information} | options
        response = cls(law, arrays["weights"], nside, **options)
        sample = response._sample_law()
        same = (response.calibration, response.information) == (calibration, information)
        if not same or sample.shape != arrays["law"].shape or not np.allclose(sample, arrays["law"], rtol=0, atol=1e-9):
            raise ParameterError(
                "this factor belongs to another scanning law or calibration, or to other steps: compute it again"
            )
        response._factor = (arrays["factor"], False)
        return response

    def _sample_law(self):
        """Times and directions at some steps: what tells one law, epoch and number of steps from another."""
        steps = np.linspace(0, len(self._time) - 1, 50).astype(int)
        views = [component for view in self._view_axes for component in (*view[0][:, steps], *view[1][:, steps])]
        return np.stack([steps.astype(float), self._time[steps], *views])

    def left(
        self,
        lon: FloatArray,
        lat: FloatArray,
        scan: FloatArray,
        time: FloatArray,
        modes: Modes,
        functions: Functions,
        *,
        view: IntArray | None = None,
    ) -> FloatArray:
        """Compute what the attitude leaves along scan of functions times modes, (k, F p), functions outermost.

        Parameters
        ----------
        lon, lat : (k,) arrays
            Where the source of each observation is. [rad, ICRS]
        scan : (2, k) array
            Direction of each scan, east and north.
        time : (k,) array
            Time since the epoch. [yr]
        modes : Modes
            What is seen of the sky.
        functions : function
            From times to the functions at them, (F, k).
        view : (k,) array, optional
            +1 in the preceding field of view, −1 in the following one. Unless given, the field of view that is nearer
            to the source by the scanning law.
        """
        p, q, r = triad(lon, lat)
        m = p * scan[0] + q * scan[1]
        view = find_nearest_views(self.law, r, time + (self.epoch - self.law.start)) if view is None else view
        view_angle = -view * self.law.basic_angle
        r2, m2 = r * np.cos(view_angle) + m * np.sin(view_angle), m * np.cos(view_angle) - r * np.sin(view_angle)
        own_pixel, other_pixel = self._find_pixels(r), self._find_pixels(r2)
        own_weight, other_weight = self.weights[own_pixel], self.weights[other_pixel]
        share = (other_weight / np.maximum(own_weight + other_weight, 1e-300))[:, None]
        remainder = share * _multiply_each(functions(time), _project_modes(r, m, modes) - _project_modes(r2, m2, modes))
        parameters = self.taken(modes, functions)
        for weight, pixel, direction in ((1 - share, own_pixel, m), (share, other_pixel, m2)):
            x = parameters[5 * pixel[:, None] + np.arange(5)]
            remainder += weight * np.einsum("ik,kin->kn", self._compute_parameter_partials(pixel, direction, time), x)
        if self.calibration is not None:
            remainder -= share * view[:, None] * (self._make_angle_columns(time) @ parameters[5 * len(self.weights) :])
        return remainder

    def taken(self, modes: Modes, functions: Functions) -> FloatArray:
        """Compute what stars take up of each of the `functions` times each of the `modes`, (60 nside², F p).

        Behind it what the calibration of the basic angle takes, where it is free.
        """
        key = modes, functions(self._time).tobytes()
        if key not in self._taken:
            rhs: Any = 0.0
            stride = max(1, len(self._time) // _BLOCK_STEPS)
            for start in range(stride):
                every_nth = slice(start, None, stride)
                fields = [_project_modes(r[:, every_nth], m[:, every_nth], modes) for r, m in self._view_axes]
                difference = _multiply_each(functions(self._time[every_nth]), fields[0] - fields[1])
                rhs = rhs + self._design[every_nth].T @ (self._difference_weights[every_nth, None] * difference)
            self._taken = {key: cho_solve(self._factorise_normal(), rhs, check_finite=False)}
        return self._taken[key]

    def _factorise_normal(self):
        if self._factor is None:
            normal = (self._design.T @ self._design.multiply(self._difference_weights[:, None]).tocsr()).toarray()
            diagonal = np.diag(normal).copy()
            normal[np.diag_indices_from(normal)] += 1e-7 * diagonal + 1e-9 * diagonal.max()  # six rotations are free
            if self.calibration is not None:
                angle_indices = np.arange(5 * len(self.weights), len(normal))
                normal[angle_indices, angle_indices] += 1 / (self._scale * self.calibration.known**2)
            self._factor = cho_factor(normal, overwrite_a=True, check_finite=False)
        return self._factor

    def _make_angle_columns(self, time):
        """The basic angle by every coefficient of its calibration."""
        assert self.calibration is not None
        return self.calibration.columns(self.law, time + (self.epoch - self.law.start))

    def _find_pixels(self, r):
        return pixels_of(*angles(r), self.nside, any_size=True)

    def _compute_parameter_partials(self, pixel, m, time):
        """Motion along scan by five parameters, east and north at the centre of the pixel, (5, k)."""
        p, q, _ = triad(self._lon[pixel], self._lat[pixel])
        sun, distance = self.law.sun(time + (self.epoch - self.law.start))
        sun = rotation_matrix("ecliptic", self.law.frame) @ sun * distance
        m_east, m_north = np.sum(m * p, 0), np.sum(m * q, 0)
        return np.array([m_east, m_north, -np.sum(m * sun, 0), m_east * time, m_north * time])


def _project_modes(r, m, modes):
    """Modes along the scan m at r, (p, k)."""
    lon, lat = angles(r)
    p, q, _ = triad(lon, lat)
    basis = harmonics(lon, lat, modes)
    return basis[:, 0] * np.sum(m * p, 0) + basis[:, 1] * np.sum(m * q, 0)


def _multiply_each(functions, fields):
    """Functions (F, k) times fields (p, k): (k, F p)."""
    return np.einsum("fk,pk->kfp", functions, fields).reshape(functions.shape[1], -1)
