import numpy as np
import pytest
from astropy.cosmology import FlatLambdaCDM, Flatw0waCDM, LambdaCDM

from vsh.models.cosmology import (
    BACHCHAN_2016,
    CMB_VELOCITY_PLANCK18,
    FLAT_PLANCK13,
    compute_redshift,
    parallax_distance_ratio,
    transverse_distance,
    with_redshift,
)
from vsh.tools.errors import FieldError
from vsh.tools.units import AU_PER_YEAR

from conftest import random_field  # isort: skip

Z = np.array([0.001, 0.003, 0.01, 0.03, 0.1, 1.0])


def test_distances_and_parallaxes_of_the_conventions():
    distance = transverse_distance(Z)
    np.testing.assert_allclose(distance, [4.454, 13.354, 44.440, 132.685, 434.756, 3406.3], rtol=2e-5, atol=5e-4)
    assert pytest.approx(77.84, abs=5e-3) == 369.0 / AU_PER_YEAR
    assert 750.0 / (AU_PER_YEAR * distance[2]) == pytest.approx(3.56, abs=5e-3)


@pytest.mark.parametrize(
    "cosmology",
    [FLAT_PLANCK13, FlatLambdaCDM(70, 0.3), LambdaCDM(70, 0.3, 0.8), Flatw0waCDM(70, 0.3, w0=-0.8, wa=-0.4)],
    ids=lambda c: type(c).__name__,
)
@pytest.mark.parametrize("limits", [(1e-4, 0.03), (1e-3, 7.0), (0.5, 0.51)])
def test_many_distances_are_interpolated_to_1e_9(cosmology, limits):
    z = np.random.default_rng(1).uniform(*limits, 3000)
    exact = np.concatenate([transverse_distance(part, cosmology) for part in np.split(z, 3)])
    np.testing.assert_allclose(transverse_distance(z, cosmology), exact, rtol=1e-9)


def test_hubble_scales_apart():
    np.testing.assert_allclose(transverse_distance(Z, hubble=134.6), transverse_distance(Z) / 2)


@pytest.mark.parametrize("n", [6, 2000], ids=["exact", "interpolated"])
def test_no_distance_is_asked_for_what_has_none(n):
    seen = []

    class Spy:
        H0 = FLAT_PLANCK13.H0

        def comoving_transverse_distance(self, z):
            seen.append(np.asarray(z))
            return FLAT_PLANCK13.comoving_transverse_distance(z)

        comoving_distance = comoving_transverse_distance

    z = np.full(n, 0.01) * np.linspace(1, 2, n)
    transverse_distance(z, Spy())
    asked = len(seen)
    assert asked
    assert all((x >= 1e-4).all() for x in seen)
    for bad in (np.nan, 0.0, -0.1, 9e-5, np.inf):
        broken = z.copy()
        broken[2] = bad
        with pytest.raises(FieldError, match=f"1 of {n} redshifts give no distance"):
            transverse_distance(broken, Spy())
    assert len(seen) == asked


def test_every_reason_is_counted():
    with pytest.raises(FieldError, match="4 of 5 .* 1 missing, 2 zero or negative, 1 below 0.0001"):
        transverse_distance([0.1, np.nan, 0.0, -1.0, 5e-5])
    with pytest.raises(FieldError, match="have no redshifts"):
        transverse_distance(None)


@pytest.mark.parametrize("frame", ["heliocentric", "local-group", "cmb"])
def test_exact_zeros_stay_unknown_in_every_frame(frame):
    """Half of them became galaxies at a few Mpc by the motion of the frame alone."""
    field = random_field(40, seed=1)
    field = field._derive(redshift=np.where(np.arange(40) < 10, 0.0, 0.02), redshift_frame=frame)
    assert len(with_redshift(field)) == 30


def test_sources_without_redshift_are_left_out_by_name():
    field = random_field(6, seed=1)
    with pytest.raises(FieldError, match="no redshifts"):
        with_redshift(field)
    z = np.array([0.1, np.nan, 0.0, 0.2, 5e-5, -1.0])
    named = field._derive(redshift=z, name=np.array(list("abcdef")))
    kept = with_redshift(named)
    assert list(kept.name) == ["a", "d"]
    assert "left out 4 of 6" in kept.notes[0]
    assert "(b, c, e, f)" in kept.notes[0]
    assert len(with_redshift(named, 0.0)) == 3
    with pytest.raises(FieldError, match="No source is left"):
        with_redshift(named[[1, 2]])


def test_our_velocity():
    assert CMB_VELOCITY_PLANCK18.amplitude == pytest.approx(369.82)
    np.testing.assert_allclose(CMB_VELOCITY_PLANCK18.direction, (264.021, 48.253))
    np.testing.assert_allclose(CMB_VELOCITY_PLANCK18.direction_error, (0.011, 0.005), rtol=1e-6)
    assert CMB_VELOCITY_PLANCK18.amplitude_error == pytest.approx(0.11)
    # The paper tabulates the antapex.
    np.testing.assert_allclose(-BACHCHAN_2016.value, (25.7, 244.3, -275.3), atol=0.06)


def test_beyond_the_antipode_of_a_closed_cosmology():
    """Negative distances."""
    closed = LambdaCDM(H0=70, Om0=3.0, Ode0=3.0)
    assert (transverse_distance(np.array([0.1, 0.5]), closed) > 0).all()
    for z in (np.array([0.1, 50.0]), np.geomspace(0.1, 50, 2000)):
        with pytest.raises(FieldError, match="beyond the antipode"):
            transverse_distance(z, closed)


def test_redshifts_from_distances():
    z = np.array([2e-4, 0.01, 0.3, 1.0, 7.0])
    np.testing.assert_allclose(compute_redshift(transverse_distance(z)), z, rtol=1e-6)
    assert np.isnan(compute_redshift(np.array([np.nan])))[0]


@pytest.mark.parametrize("curvature", [-0.2, 0.0, 0.15])
def test_parallax_distance_of_a_curved_space(curvature):
    """d_P = R tan(χ/R) on a sphere of radius R, R tanh(χ/R) where it is open; d_M = R sin, or sinh (χ/R)."""
    cosmology = LambdaCDM(67.3, 0.3, 0.7 - curvature)
    z = np.array([0.01, 0.5, 1.5])
    far = cosmology.comoving_distance(z).value
    distance = cosmology.comoving_transverse_distance(z).value
    if curvature:
        radius = 299792.458 / 67.3 / np.sqrt(abs(cosmology.Ok0))
        far = radius * (np.tan if curvature < 0 else np.tanh)(far / radius)
    np.testing.assert_allclose(distance / far, parallax_distance_ratio(distance, cosmology), rtol=1e-9)
