"""Is a sample complete to its faintest magnitude? Rauzy's T_C, and what calibrations make of a sample that is not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many

import sim
from fit.distances import calibrate
from fit.distances._density import (
    compute_completeness_deviate,
    count_absolute_magnitudes,
    find_completeness_limit_and_counts,
)
from fit.secular_parallax import observer_velocity
from vsh import Field
from vsh.models.cosmology import distance_modulus, transverse_distance

VELOCITY = np.array([300.0, -180.0, 120.0])


def galaxies(seed, n=1500, softness=0.0):
    """A Schechter function in volume to magnitude 13.5, which fades out `softness` brighter; velocities of 300 km/s."""
    rng = np.random.default_rng(seed)
    number = 300_000
    distance = 100 * rng.uniform(size=number) ** (1 / 3)
    z = distance * 70 / 299792.458
    absolute = -20 - 2.5 * np.log10(rng.gamma(0.3, 1.0, number) + 1e-9)
    magnitude = absolute + 5 * np.log10(distance) + 25
    seen = (magnitude < 13.5) & (z > 0.002)
    if softness:
        seen &= rng.uniform(size=number) < 1 / (1 + np.exp((magnitude - 13.5 + softness) / 0.3))
    at = rng.permutation(np.flatnonzero(seen))[:n]
    lon, lat = sim.uniform_sky(len(at), rng)
    sigma = np.broadcast_to(3 + 0.5 * 10 ** (0.4 * (magnitude[at] - 11)), (2, len(at)))
    own = rng.normal(0, 300, (2, len(at))) / (4.74047 * distance[at])
    motion = sim.secular_parallax(VELOCITY, hubble=70)(lon, lat, z[at]) + own + sigma * rng.normal(size=(2, len(at)))
    observed = z[at] + (1 + z[at]) * rng.normal(0, 300 / 299792.458, len(at))
    field = Field(lon, lat, motion, sigma, redshift=observed, magnitude=magnitude[at], redshift_frame="cmb")
    return field[observed > 0.0015]


def table(field):
    modulus = distance_modulus(transverse_distance(field.redshift), field.redshift)
    return count_absolute_magnitudes(field.magnitude, modulus)


@few_or_many(12, 100)
def test_deviate_of_complete_samples_is_normal(n_skies):
    deviates = []
    for seed in range(n_skies):
        field = galaxies(seed)
        deviates.append(compute_completeness_deviate(table(field), field.magnitude.max()))
    assert abs(np.mean(deviates)) < 0.5 + 3 / np.sqrt(n_skies)
    assert np.std(deviates) < 1.0 + 2.5 / np.sqrt(2 * n_skies)
    assert min(deviates) > -3.5


def test_sample_that_fades_out_is_complete_to_a_brighter_magnitude():
    field = galaxies(1, n=4000, softness=1.0)
    limit, brighter = find_completeness_limit_and_counts(table(field), field.magnitude.max())
    assert 11 < limit < 12.8
    assert brighter.sum() < 0.8 * len(field)
    notes = calibrate(field, dispersion=300.0).notes
    assert any("the sample is complete to magnitude" in note for note in notes)
    assert not any("complete to magnitude" in note for note in calibrate(galaxies(1), dispersion=300.0).notes)


def test_list_that_somebody_chose_is_complete_to_a_brighter_magnitude():
    """Bright galaxies are missing as well as faint ones."""
    field = galaxies(2, n=3000)
    wanted = np.exp(-0.5 * ((field.magnitude - 11.5) / 0.4) ** 2)
    chosen = field[np.random.default_rng(2).uniform(size=len(field)) < wanted]
    notes = " ".join(calibrate(chosen, dispersion=300.0).notes)
    limit = float(re.search(r"the sample is complete to magnitude ([\d.]+), not to its faintest", notes)[1])
    assert limit < chosen.magnitude.max() - 0.5


@pytest.mark.parametrize(
    ("gap", "asked", "is_used", "note"),
    [
        (1.5, None, True, ""),
        (2.5, None, False, "magnitudes are not used"),
        (np.nan, True, True, "complete to no limit"),
    ],
)
def test_magnitudes_of_inhomogeneous_lists_are_left_out(monkeypatch, gap, asked, is_used, note):
    """Unless they are asked for; where they were complete to no limit, nothing was said."""
    finder = "fit.distances._calibration.find_completeness_limit_and_counts"
    monkeypatch.setattr(finder, lambda bright, faintest: (faintest - gap, bright))
    calibration = calibrate(galaxies(1), dispersion=300.0, magnitudes=asked)
    assert (calibration.luminosity is not None) == is_used
    told = [each for each in ("magnitudes are not used", "complete to no limit") if each in " ".join(calibration.notes)]
    assert told == [note] * bool(note)


@pytest.mark.slow
@few_or_many(12, 200)
@pytest.mark.parametrize("softness", [0.0, 0.3, 1.0])
def test_velocity_covers_whether_complete_or_not(softness, n_skies):
    pulls = []
    for seed in range(n_skies):
        v = observer_velocity(galaxies(seed, softness=softness), 70.0, flows=None, peculiar_dispersion=300.0).velocity
        pulls.append((v.to_frame("icrs").value - VELOCITY) / v.sigma)
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1, abs=0.1 + 4 / np.sqrt(6 * n_skies))


def test_few_sources_with_huge_errors_are_counted():
    """Without magnitudes all sources of a redshift have their mean variance: one error of 0.1 arcsec/yr was in all."""
    field = galaxies(3, n=1500)
    field = replace(field, magnitude=None)
    assert not any("half of the variance" in note for note in calibrate(field, dispersion=300.0).notes)
    sigma = np.array(field.sigma)
    sigma[:, 700] = 1e6
    (note,) = [n for n in calibrate(replace(field, sigma=sigma), dispersion=300.0).notes if "half of the variance" in n]
    assert note.startswith(f"warning: 1 of {len(field)} sources")
