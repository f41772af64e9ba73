"""The frame of Gaia's bright stars."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fit
import sim
from fit.frames.link import link
from vsh import Field, FieldError, ParameterError
from vsh.models.bright_stars import CANTAT_GAUDIN_BRANDT_2021, published_spin


def stars(n=300, seed=1, magnitude=None):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    magnitude = rng.uniform(6, 16, n) if magnitude is None else np.full(n, magnitude)
    return Field(lon, lat, np.zeros((2, n)), np.ones((2, n)), magnitude=magnitude)


@pytest.mark.parametrize(
    ("magnitude", "spin"), [(5.0, (18.4, 33.8, -11.3)), (12.99, (34.9, 68.9, -2.9)), (13.0, (0, 0, 0))]
)
def test_spin_of_a_magnitude_is_the_published_one(magnitude, spin):
    field = stars(magnitude=magnitude)
    assert_allclose(CANTAT_GAUDIN_BRANDT_2021(field), sim.spin(spin)(field.lon, field.lat), atol=1e-12)


def test_corrected_motions_do_not_turn_in_any_axes():
    plain = stars()
    turned = plain.minus(-CANTAT_GAUDIN_BRANDT_2021(plain))
    for frame in ("icrs", "galactic"):
        corrected = turned.to_frame(frame).corrected(CANTAT_GAUDIN_BRANDT_2021)
        assert_allclose(corrected.motion, 0, atol=1e-9)
        assert "motions are corrected by CANTAT_GAUDIN_BRANDT_2021" in corrected.notes


def test_fit_corrects_as_well():
    field = stars().minus(-sim.spin((1.0, 2.0, 3.0))(stars().lon, stars().lat))
    solution = fit.fit_field(field, 1)
    for frame in ("icrs", "galactic"):  # a result is taken in its own axes
        assert_allclose(field.to_frame(frame).corrected(solution).motion, 0, atol=1e-9)
    for wrong in (None, replace(solution, unit="µas")):
        with pytest.raises(ParameterError, match="a correction is"):
            field.corrected(wrong)


def test_sources_without_magnitudes_are_counted():
    magnitude = np.where(np.arange(300) < 7, np.nan, 10.0)
    with pytest.raises(FieldError, match="7 of 300 sources have no magnitude"):
        CANTAT_GAUDIN_BRANDT_2021(stars(magnitude=magnitude))


def test_link_has_the_published_spin_beside_its_own():
    """A frame with the published spin, over the jump at 13: the fitted one agrees with the line that is printed."""
    spin = published_spin(12.9)
    data = sim.link(1, 120, spin=spin)
    solution = link(data, steps=[13.0], robust=False)
    found = solution.vector("spin", 12.9)
    assert np.abs((found.value - spin) / found.sigma).max() < 4
    median = np.median(solution.magnitude[solution.magnitude < 13])
    (line,) = (text for name, text in solution.sections()[0].facts if name == "published")
    assert [float(text) for text in re.findall(r"[+-]?\d+\.\d", line)[:3]] == published_spin(median).tolist()
    other = link(replace(data, catalogue=np.where(data.catalogue == "gaia", "hip", "vlbi")), robust=False)
    assert "published" not in dict(other.sections()[0].facts)
