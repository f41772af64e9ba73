"""Errors to come: spin, acceleration, waves, shear, our Galaxy, our velocity and H0, for surveys side by side.

A survey is a catalogue that there is or will be: how many sources, and how well each is measured.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import chdtri

from fit.correlation import predict_covariance
from fit.motions.galaxy import R0, circular_speed, distance_of_centre, expected_acceleration
from fit.motions.shear import to_tensor
from fit.secular_parallax import predict_errors as predict_velocity
from sim.astrometry import POSITION_FACTORS, RELEASES, gaia_errors, parallax_error
from sim.population import CRF3_COUNTS, SIX_PARAMETERS, draw_crf3_magnitudes, galaxies
from vsh import Coefficients, Field
from vsh.io import tables
from vsh.io.sections import Answer, Section, text_of
from vsh.models.cosmology import FLAT_PLANCK13, transverse_distance
from vsh.models.covariance import LINDEGREN_2021, Spectrum
from vsh.modes import Modes
from vsh.sky.astrometry import add_positions
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import AxesArray, BoolArray, FloatArray, OnAxes, Release, Rng, Table
from vsh.tools.units import AU_PER_YEAR, hubble_rate


@dataclass(frozen=True)
class SecondEpoch(InNotebook):
    """Positions of another survey, measured in Gaia's frame, for the sources in its part of the sky.

    Attributes
    ----------
    error : float, or a release of Gaia
        Error of a position in each component [µas]; or as this release has it at each magnitude.
    years : float
        Mean epoch of the survey minus that of the release. [yr]
    latitude, ecliptic_latitude : float
        Sources at smaller |latitude|, Galactic or ecliptic, are not in the survey. [deg]
    declination : (low, high) of float
        Range of the survey. [deg]
    """

    error: float | Release
    years: float
    latitude: float = 0.0
    ecliptic_latitude: float = 0.0
    declination: tuple[float, float] = (-90.0, 90.0)

    def covers(self, lon: FloatArray, lat: FloatArray) -> BoolArray:
        """Mask of the ICRS positions `lon`, `lat` that are in the survey. [rad]"""
        direction = triad(lon, lat)[2]
        latitudes = (angles(rotation_matrix("icrs", frame) @ direction)[1] for frame in ("galactic", "ecliptic"))
        galactic, ecliptic_latitude = np.degrees(np.abs(list(latitudes)))
        lower, upper = np.radians(self.declination)
        return (galactic > self.latitude) & (ecliptic_latitude > self.ecliptic_latitude) & (lat > lower) & (lat < upper)

    def motion_errors(self, magnitude: FloatArray, factor: FloatArray, release: Release) -> FloatArray:
        """Errors of joint motions, (2, n), with Gaia's `factor` times those of `release` at `magnitude`. [µas/yr]"""
        sigma = np.concatenate([
            np.multiply.outer([*POSITION_FACTORS, 1.0], parallax_error(magnitude, release)),
            gaia_errors(magnitude, release),
        ])  # fmt: skip
        covariance = np.einsum("in,ij->nij", (factor * sigma) ** 2, np.eye(5))
        errors: Any = self.error
        if isinstance(self.error, str):
            errors = factor * np.multiply.outer(POSITION_FACTORS, parallax_error(magnitude, self.error))
        position_covariance = np.einsum("in,ij->nij", np.broadcast_to(errors, (2, len(magnitude))) ** 2, np.eye(2))
        joint_covariance = add_positions(covariance, position_covariance, self.years)
        return np.sqrt(np.stack([joint_covariance[:, 3, 3], joint_covariance[:, 4, 4]]))


@dataclass(frozen=True)
class Survey(InNotebook):
    """A catalogue of quasars, and of galaxies where it has some. A new one is a new value of this.

    Attributes
    ----------
    n_quasars : int
        Sources at rest.
    release : {"DR3", "DR4", "DR5"} or None
        Release whose errors at each magnitude are taken, for the magnitudes of Gaia's quasars.
    factor : float
        By which these errors are multiplied.
    sigma : float, tuple of float or None
        One error for all, or the errors of equal shares of the sources, in place of a release's. [µas/yr]
    n_galaxies : int
        Within z = 0.03; 0 where there are none.
    floor : float
        Systematic errors: an error of each component of spin and acceleration that no number of them lowers. [µas/yr]
    second : SecondEpoch or None
        Positions of another survey that are added to the release's astrometry.
    says : str
        Where the numbers come from.
    """

    n_quasars: int
    release: Any = None
    factor: float = 1.0
    sigma: Any = None
    n_galaxies: int = 0
    floor: float = 0.0
    says: str = ""
    second: SecondEpoch | None = None

    def __post_init__(self) -> None:
        """Check that errors can follow from it."""
        arguments.whole("n_quasars", self.n_quasars)
        arguments.whole("n_galaxies", self.n_galaxies, least=0)
        arguments.positive("factor", self.factor)
        arguments.not_negative("floor", self.floor)
        if (self.release is None) == (self.sigma is None):
            raise ParameterError("a survey has the errors of a release, or one sigma for all: one of the two")
        if self.sigma is not None:
            for sigma in np.atleast_1d(self.sigma):
                arguments.positive("sigma", sigma)
            if self.second is not None:
                raise ParameterError("positions are added to the astrometry of a release: give one")

    def errors(self, lon: FloatArray, lat: FloatArray) -> FloatArray:
        """Errors of quasars at ICRS positions `lon`, `lat`, (2, n), of as much information as all have. [µas/yr]"""
        errors = np.empty((2, len(lon)))
        if self.release is None:
            errors[:] = self._average_own_errors()[:, None]
        else:
            magnitude, factor = _draw_crf3_magnitudes_and_factors()
            errors[:] = _average_errors(factor * gaia_errors(magnitude, self.release))[:, None]
            if self.second is not None:
                is_covered = self.second.covers(lon, lat)
                errors_with_second = self.second.motion_errors(magnitude, factor, self.release)
                errors[:, is_covered] = _average_errors(errors_with_second)[:, None]
        return errors * self.factor * np.sqrt(len(lon) / self.n_quasars)

    def galaxy_errors(self, magnitude: FloatArray, lon: FloatArray, lat: FloatArray) -> FloatArray:
        """Errors of galaxies of `magnitude` G at ICRS positions `lon`, `lat`, as of points, (2, n). [µas/yr]"""
        if self.release is None:
            return np.tile(self._average_own_errors()[:, None], len(magnitude)) * self.factor
        errors = gaia_errors(magnitude, self.release)
        if self.second is not None:
            covered = self.second.covers(lon, lat)
            errors[:, covered] = self.second.motion_errors(magnitude[covered], np.ones(covered.sum()), self.release)
        return errors * self.factor

    def _average_own_errors(self):
        """Error of as much information as those of `sigma` have, (2,)."""
        return _average_errors(np.tile(np.atleast_1d(self.sigma), (2, 1)))


def _average_errors(sigma):
    """Error of as much information as several have, for each component."""
    return 1 / np.sqrt(np.mean(1 / sigma**2, axis=1))


@lru_cache(maxsize=1)
def _draw_crf3_magnitudes_and_factors():
    """Magnitudes of Gaia-CRF3's quasars, and factors on their errors: information to half a per cent."""
    five, six = (count // 8 for count in CRF3_COUNTS.values())
    return draw_crf3_magnitudes(five, six, 1), np.where(np.arange(five + six) < five, 1.0, SIX_PARAMETERS)


_N_QUASARS, _N_GALAXIES = sum(CRF3_COUNTS.values()), 100_000
#: Systematic motions of Gaia-CRF3 on angles beyond 15° (abstract of Gaia Collaboration 2022, A&A 667, A148) [µas/yr],
#: and the highest degree of such angles.
_CRF3_SYSTEMATICS, _CRF3_MAX_DEGREE = 12.0, 12
#: Floor of DR3: that of a field of these motions with one power for all modes. [µas/yr]
_FLOOR = (
    _CRF3_SYSTEMATICS
    * Spectrum.flat().acceleration_error
    * float(np.sqrt(4 * np.pi / Spectrum.flat().power(_CRF3_MAX_DEGREE).sum()))
)
#: Floors of DR4 and DR5, an assumption: they decrease like the errors of motions.
_FLOORS = {release: _FLOOR * RELEASES[release][0] * RELEASES[release][1] / RELEASES["DR3"][1] for release in RELEASES}
#: Median errors of five equal shares of the VLBA's motions (Truebenbach & Darling 2017, ApJS 233, 3). [µas/yr]
_VLBA = (2.1, 5.5, 9.6, 15.6, 39.2)


#: Years of observations in DR5, and from their mean to that of a successor.
_DR5_YEARS, _SUCCESSOR_YEARS = 10.0, 27.7


def _gaia(says: str, release: Release = "DR5", second: SecondEpoch | None = None, floor: float | None = None) -> Survey:
    """A release, perhaps with positions of another survey, which keep its floor unless they have theirs."""
    floor = _FLOORS[release] if floor is None else floor
    return Survey(_N_QUASARS, release, n_galaxies=_N_GALAXIES, floor=floor, says=says, second=second)


#: By name. Floors beyond DR3 are an assumption.
SURVEYS = {
    "Gaia DR3": _gaia("quasars of Gaia-CRF3", "DR3"),
    "Gaia DR4": _gaia("the same quasars, 66 months of data", "DR4"),
    "Gaia DR5": _gaia("the same quasars, ten years of data"),
    "DR5 + Euclid": _gaia(
        "positions at J2027.5 in 14 000 deg², four exposures of 0.7 mas (Libralato et al. 2024, arXiv:2411.02487)",
        second=SecondEpoch(350.0, 7.7, latitude=30.0, ecliptic_latitude=15.0),
    ),
    "DR5 + Roman": _gaia(
        "positions at J2029.5 in 5100 deg², ten exposures of 0.01 pixel (Sanderson et al. 2019, JATIS 5, 044005)",
        second=SecondEpoch(350.0, 9.7, latitude=43.0, declination=(-45.0, 0.0)),
    ),
    "DR5 + Rubin": _gaia(
        "positions at J2031 in 18 000 deg², 825 visits of 11 mas (Ivezić et al. 2019, ApJ 873, 111)",
        second=SecondEpoch(400.0, 11.2, latitude=15.0, declination=(-70.0, 12.5)),
    ),
    "near infrared": _gaia(
        "positions by a successor to Gaia launched in 2045, at J2047.5 with DR4's errors by magnitude: it is to be "
        "as precise as Gaia (Hobbs et al. 2021, Exp. Astron. 51, 783); floor: that of DR5 by the time between",
        second=SecondEpoch("DR4", _SUCCESSOR_YEARS), floor=_FLOORS["DR5"] * _DR5_YEARS / _SUCCESSOR_YEARS,
    ),
    "VLBI": Survey(
        1500, sigma=_VLBA, floor=0.1,
        says="assumed: 1500 sources with the distribution of errors of Truebenbach & Darling (2017)",
    ),
    "SKA": Survey(
        10_000, sigma=_VLBA, floor=0.1,
        says="assumed: 10 000 sources with the errors of VLBI (VLBI with the SKA)",
    ),
}  # fmt: skip
#: What is forecast: words and unit, in the order of the table.
QUANTITIES = {
    "spin": ("spin, per component", "µas/yr"),
    "acceleration": ("acceleration, per component", "µas/yr"),
    "acceleration_floor": ("  systematic floor included", "µas/yr"),
    "acceleration_law": ("  with DR3's angular covariance", "µas/yr"),
    "direction": ("  direction, floor included", "°"),
    "speed": ("circular speed V0, floor included", "km/s"),
    "r0": ("R0 from the motion of Sgr A*, floor included", "kpc"),
    "waves": ("95 % limit on h70² Ω of gravitational waves, floor included", ""),
    "wave": ("  error of the strain rate of one wave, noise only", "µas/yr"),
    "shear": ("shear, per component", "% of H0"),
    "degree": ("highest degree at which systematics as DR3's exceed the noise", ""),
    "velocity": ("our velocity, per component", "km/s"),
    "hubble": ("H0", "km/s/Mpc"),
    "velocity_flows": ("  our velocity, flows fitted", "km/s"),
    "hubble_flows": ("  H0, flows fitted", "km/s/Mpc"),
}


#: So many stand for all: so many quasars; of galaxies the nearest and every twentieth of the rest, fewer where flows
#: are unknowns.
_SAMPLE_QUASARS, _SAMPLE_GALAXIES, _N_NEAREST, _STRIDE, _FLOW_GALAXIES = 5000, 100_000, 4000, 20, 2000
#: The highest degree that is looked at.
_MAX_DEGREE = 400
_FLOW_MODES, _HUBBLE = 40, 70.0
#: What the published angular covariance of DR3 implies for each component of spin and acceleration. [µas/yr]
_COVARIANCE_LAW_FLOOR = Spectrum.from_covariance(LINDEGREN_2021).acceleration_error
#: Beside no flows, as forecasts of the field have it; and beyond flows. They are put into the errors. [km/s]
_DISPERSION_WITHOUT_FLOWS, _DISPERSION_BEYOND_FLOWS, _NO_DISPERSION = 300.0, 150.0, 1e-3
#: Quantities of a short report: what a proposal quotes, with what nature adds to the noise.
_SHORT_REPORT = (
    "acceleration", "acceleration_floor", "speed", "waves", "velocity", "hubble", "velocity_flows",
    "hubble_flows",
)  # fmt: skip


@dataclass(frozen=True)
class SurveyForecast(InNotebook):
    """Errors to come.

    Attributes
    ----------
    surveys : dict of str to Survey
    values : dict of str to dict
        Values of each survey, by the names of `QUANTITIES`; nan where it has no galaxies.
    sky : str
        How the quasars are spread.
    """

    surveys: dict[str, Survey]
    values: dict[str, dict[str, float]]
    sky: str

    def __str__(self) -> str:
        return self.report()

    def sections(self, *, long: bool = False) -> tuple[Section, ...]:
        """The errors to come, a column for each survey.

        Parameters
        ----------
        long : bool
            Give every quantity, and the source of each survey.
        """
        rows = [
            ("quasars", *(str(survey.n_quasars) for survey in self.surveys.values())),
            ("galaxies", *(str(survey.n_galaxies or "") for survey in self.surveys.values())),
        ]
        for name, (description, unit) in QUANTITIES.items():
            if long or name in _SHORT_REPORT:
                cells = [self.values[survey][name] for survey in self.surveys]
                if np.isnan(cells).all():  # not asked for, or no survey has galaxies
                    continue
                number_format = ".0f" if name == "degree" else ".3g"
                label = description + (f" [{unit}]" if unit else "")
                rows.append((label, *("" if np.isnan(cell) else f"{cell:{number_format}}" for cell in cells)))
        column_heads = ("expected errors (68 % unless stated otherwise)", *self.surveys)
        table = tables.table_of_rows(column_heads, rows)
        facts = [("sky", f"quasars: {self.sky}; galaxies: to z = 0.03, errors of faint galaxies as those of Gaia")]
        has_flows = np.isfinite([values["hubble_flows"] for values in self.values.values()]).any()
        velocities_remark = (
            "velocities and H0 with fitted flows include the cosmic variance of one sky in linear theory"
            if has_flows
            else "velocities and H0 are for independent peculiar velocities of 300 km/s: flows make errors several "
            "times larger on the real sky"
        )
        remarks = [f"Floors beyond DR3 are assumptions; {velocities_remark}."]
        if long:
            facts += [
                (name, f"{survey.says}; systematic floor {survey.floor:.3g} µas/yr")
                for name, survey in self.surveys.items()
            ]
            remarks = [
                "Floors beyond DR3 are assumptions; the errors of direction, V0, R0 and Ω include the floors. DR3's "
                "angular covariance (Lindegren et al. "
                f"2021, 292 exp(−θ/12°) µas²/yr²) implies a floor of {_COVARIANCE_LAW_FLOOR:.1f} µas/yr at degree 1, "
                f"{_COVARIANCE_LAW_FLOOR / _FLOOR:.1f} times as much; the acceleration measured by DR3 (5.05 "
                "µas/yr, with 4.8 expected) excludes such a floor.",
                "Velocity and H0 are for independent peculiar velocities of 300 km/s; with flows fitted, they are for "
                "flows of linear theory and include the "
                "cosmic variance of one sky.",
            ]
        return (Section("Forecast of surveys", facts, table, remarks=remarks),)

    def report(self, *, long: bool = False) -> str:
        """The lines to quote and the table as text.

        Parameters
        ----------
        long : bool
            As for `sections`.
        """
        return f"{self.answer}\n\n{text_of(self.sections(long=long))}"

    @property
    def answer(self) -> Answer:
        """The lines to quote: errors of acceleration and H0 by survey, with what nature adds to the noise."""
        lines = []
        for name, survey in self.surveys.items():
            floor = "systematic floor included" if survey.floor else "no systematic floor assumed"
            quantities = (
                ("acceleration_floor", "acceleration", f" per component, {floor}"),
                ("hubble_flows", "H0", ", flows fitted"),
            )
            entries = [(label, self.values[name][key], QUANTITIES[key][1], suffix) for key, label, suffix in quantities]
            phrases = [
                f"{label} ± {value:.2g} {unit}{suffix}" for label, value, unit, suffix in entries if np.isfinite(value)
            ]
            lines.append((name, "; ".join(phrases) or "nothing to quote"))
        return Answer(tuple(lines))

    def to_table(self) -> Table:
        """A row for each survey, as an astropy Table."""
        columns: dict[str, Any] = {
            "survey": list(self.surveys),
            "quasars": [survey.n_quasars for survey in self.surveys.values()],
            "galaxies": [survey.n_galaxies for survey in self.surveys.values()],
        }
        columns |= {name: [float(self.values[survey][name]) for survey in self.surveys] for name in QUANTITIES}
        units = {"km/s/Mpc": "km / (s Mpc)", "% of H0": "%"}  # what astropy reads otherwise, or not
        return tables.table_of(
            columns, {"sky": self.sky}, {name: units.get(unit, unit) for name, (_, unit) in QUANTITIES.items() if unit}
        )

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Plot every quantity by survey, a panel each; on matplotlib axes."""
        from study.forecast._plot import plot_forecast

        return plot_forecast(self, ax=ax)


@arguments.accepts(rng=arguments.seed)
def forecast_surveys(
    surveys: Mapping[str, Survey] | None = None, *, sky: str = "uniform", flows: bool = True, rng: Rng = 1
) -> SurveyForecast:
    """Errors to come of surveys, side by side, in a few seconds.

    Parameters
    ----------
    surveys : dict of str to Survey, optional
        By name; `SURVEYS` unless given.
    sky : {"uniform", "gums", "igql"}
        How the quasars are spread: evenly, behind no Galactic plane, or as in the list of known quasars.
    flows : bool
        Velocity and H0 with flows as unknowns, too.
    rng : Generator or int
        Random numbers of galaxies and of places on a map; errors move with them by a per cent or two.

    Raises
    ------
    ParameterError
        If there are no surveys, or no such sky.

    Notes
    -----
    5000 quasars, and some 9000 of 100 000 galaxies (2000 with flows), stand for all, with errors that carry the same
    information; covariances are those of fits to degree 2. Direction, V0, R0 and Ω hold the floor of the survey.
    "Degrees": to which a field with the power of DR3's systematics at large angles (Lindegren et al. 2021) stands above
    the noise, kind by kind. Waves: what noise alone gives with 95 % in degree 2; one wave: the error of its rate when
    its direction is known.
    """
    surveys = dict(SURVEYS if surveys is None else arguments.a(dict)("surveys", surveys))
    if not surveys or not all(isinstance(candidate, Survey) for candidate in surveys.values()):
        raise ParameterError("a forecast is of one Survey at least, by name")
    arguments.choice("sky", sky, ("uniform", "gums", "igql"))
    random_generator = arguments.generator(rng)
    (position_rng,) = random_generator.spawn(1)
    lon, lat = _place_quasars(sky, position_rng)
    no_motion = np.zeros((2, len(lon)))
    systematic_power = Spectrum.from_covariance(LINDEGREN_2021).power(_MAX_DEGREE)[0]
    sample = galaxies(_SAMPLE_GALAXIES, random_generator)
    values = {
        name: (
            _forecast_quasar_errors(Field(lon, lat, no_motion, survey.errors(lon, lat)), survey, systematic_power)
            | _forecast_galaxy_errors(survey, sample, flows)
        )
        for name, survey in surveys.items()
    }
    return SurveyForecast(surveys, values, sky)


def _place_quasars(sky, rng):
    """Positions of the quasars that stand for all."""
    if sky != "uniform":
        from sim.skies import draw_positions  # healpy, for maps alone

        return draw_positions(_SAMPLE_QUASARS, rng, sky)
    # A spiral by the golden angle: evener than a draw.
    i = np.arange(_SAMPLE_QUASARS)
    return i * np.pi * (3 - np.sqrt(5)) % (2 * np.pi), np.arcsin((2 * i + 1) / _SAMPLE_QUASARS - 1)


def _forecast_quasar_errors(field, survey, systematic_power):
    prediction = predict_covariance(field, 2)
    spin, acceleration = (float(np.sqrt(np.mean(part.sigma**2))) for part in (prediction.spin, prediction.acceleration))
    model_acceleration = expected_acceleration(R0[0])
    # Noise in degree 2, both kinds: on an even sky 4π/(n w) a coefficient, T and S alike.
    noise = (prediction.noise_power("T", 2) + prediction.noise_power("S", 2)) / 10
    # A floor of degree 1 has as much power in each mode of degree 2; of the published law it is a share.
    total_error, floor_power = float(np.hypot(acceleration, survey.floor)), 8 * np.pi / 3 * survey.floor**2
    law_floor = _COVARIANCE_LAW_FLOOR * survey.floor / _FLOOR if survey.release else survey.floor
    shear_tensors = [to_tensor(Coefficients(Modes(2), row)) for row in np.linalg.cholesky(prediction.covariance).T]
    degrees = np.arange(1, _MAX_DEGREE + 1)
    return {
        "spin": spin,
        "acceleration": acceleration,
        "acceleration_floor": total_error,
        "acceleration_law": float(np.hypot(acceleration, law_floor)),
        "direction": float(np.degrees(total_error / model_acceleration)),
        "speed": circular_speed(model_acceleration, total_error, *R0)[1],
        "r0": distance_of_centre(model_acceleration, total_error)[1],
        "waves": 6 / 5 * (noise + floor_power) * float(chdtri(10, 0.05)) / (4 * np.pi * hubble_rate(_HUBBLE) ** 2),
        "wave": float(np.sqrt(noise * 6 / (4 * np.pi))),
        "shear": 100 * float(np.sqrt(np.mean(np.sum(np.square(shear_tensors), axis=0)))) / hubble_rate(_HUBBLE),
        "degree": float(np.argmin(np.append(systematic_power > (2 * degrees + 1) * noise, False))),
    }


def _forecast_galaxy_errors(survey, sample, flows):
    values = dict.fromkeys(("velocity", "hubble", "velocity_flows", "hubble_flows"), float("nan"))
    if not survey.n_galaxies:
        return values
    order = np.argsort(sample.redshift)
    # The nearest weigh most: all of them, and of the rest every twentieth for twenty.
    rows = np.concatenate([order[:_N_NEAREST], order[_N_NEAREST::_STRIDE]])
    n_each = np.where(np.arange(len(rows)) < _N_NEAREST, 1, _STRIDE)
    plain_errors = _combine_errors(survey, sample[rows], _DISPERSION_WITHOUT_FLOWS, n_each)
    values["velocity"], values["hubble"] = _predict_velocity_errors(sample[rows], plain_errors, flows=None)
    if flows:
        rows = order[:: len(order) // _FLOW_GALAXIES]
        errors = _combine_errors(survey, sample[rows], _DISPERSION_BEYOND_FLOWS, len(order) / len(rows))
        pair = _predict_velocity_errors(sample[rows], errors, flows="linear", n_modes=_FLOW_MODES)
        values["velocity_flows"], values["hubble_flows"] = pair
    return values


def _combine_errors(survey, sample, dispersion, n_each):
    """Errors of galaxies that stand for several each, their peculiar velocities included. [µas/yr]"""
    velocity_scatter = dispersion / (AU_PER_YEAR * transverse_distance(sample.redshift, FLAT_PLANCK13))
    errors = survey.galaxy_errors(sample.magnitude, sample.lon, sample.lat)
    return np.hypot(errors, velocity_scatter) / np.sqrt(n_each * survey.n_galaxies / _SAMPLE_GALAXIES)


def _predict_velocity_errors(sample, errors, **options):
    field = Field(sample.lon, sample.lat, np.zeros_like(errors), errors, redshift=sample.redshift)
    velocity, hubble = predict_velocity(field, 67.3, peculiar_dispersion=_NO_DISPERSION, left_out=False, **options)
    return float(np.sqrt(np.trace(velocity.velocity.covariance) / 3)), float(hubble.hubble_error)
