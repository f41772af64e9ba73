"""One plane wave: its exact motions beside its closed-form coefficients."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sim
from vsh import Mode, ParameterError
from vsh.models.waves import compute_degree_amplitudes, compute_strain, wave_coefficients, wave_motions
from vsh.sky.pixels import centres
from vsh.transform import adjoint

DIRECTIONS = [(0, 0, 1), (0, 0, -1), (1, 0, 0), (1, 2, -0.5)]


def test_numbers():
    expected = [0, 0.660556, -0.247156, 0.125333, -0.074065, 0.048117]
    # Found by projection, to some 2e-6; √(5π/36) = 0.6605545.
    assert_allclose(compute_degree_amplitudes(6), expected, atol=3e-6)
    assert compute_degree_amplitudes(2)[1] == pytest.approx(np.sqrt(5 * np.pi / 36), rel=1e-12)
    for polarisation, places in (
        ((1, 0), {("T", "im"): 1, ("S", "re"): -1}),
        ((0, 1), {("T", "re"): 1, ("S", "im"): 1}),
    ):
        wave = wave_coefficients((0, 0, 3), *polarisation, lmax=6)
        values = np.zeros(len(wave.modes))
        for (kind, part), sign in places.items():
            for l in range(2, 7):
                values[wave.modes.index(Mode(kind, l, 2, part))] = sign * expected[l - 1]
        assert_allclose(wave.values, values, atol=3e-6)
    assert compute_strain(1.0, 10.0) == pytest.approx(2.445e-12, rel=2e-4)
    assert compute_strain(1.0, 1.0) == pytest.approx(2.445e-11, rel=2e-4)


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("amplitudes", [(1.0, 0.0), (0.0, 1.0), (0.3, -0.8)])
def test_motions_are_those_of_the_coefficients(direction, amplitudes):
    """Projected on harmonics by quadrature over HEALPix, to its accuracy."""
    lon, lat = centres(64)
    wave = wave_coefficients(direction, *amplitudes, lmax=8)
    motion = wave_motions(lon, lat, direction, *amplitudes)
    projected = adjoint(8, lon, lat, motion) * 4 * np.pi / lon.size / wave.modes.norm2
    assert_allclose(projected, wave.values, atol=3e-4)
    assert_allclose(sim.plane_wave(direction, *amplitudes)(lon, lat), motion)
    power = np.sum(motion**2, axis=0).mean() * 4 * np.pi
    assert power == pytest.approx(2 * np.pi / 3 * np.hypot(*amplitudes) ** 2, rel=1e-3)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_where_the_wave_comes_from_and_goes_to(direction):
    k = np.array(direction) / np.linalg.norm(direction)
    for sign in (1, -1):
        lon, lat = np.arctan2(sign * k[1], sign * k[0]), np.arcsin(sign * k[2])
        assert np.isfinite(wave_motions([lon], [lat], direction, 1.0)).all()
    assert_allclose(wave_motions([np.arctan2(k[1], k[0])], [np.arcsin(k[2])], direction, 1.0), 0, atol=1e-12)


def test_messages():
    for bad, said in (((0, 0, 0), "some length"), ((1, 2), "has shape"), ((np.nan, 0, 1), "not finite")):
        with pytest.raises(ParameterError, match=said):
            sim.plane_wave(bad, 1.0)
    with pytest.raises(ParameterError, match="plus must be a finite number"):
        sim.plane_wave((0, 0, 1), "strong")
    with pytest.raises(ParameterError, match="frequency must be above zero"):
        compute_strain(1.0, 0.0)
