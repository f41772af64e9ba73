"""The reference values of docs/theory.md."""

import numpy as np
import pytest
from conftest import random_field
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import fit
import sim
from vsh import Coefficients, Mode, Modes, Vector
from vsh.conventions import ICRF3, from_healpy, from_icrf3, from_vityazev, to_healpy, to_icrf3, to_vityazev
from vsh.tools import units
from vsh.tools.errors import ModesError

values = arrays(float, len(Modes(2)), elements=st.floats(-1e3, 1e3, allow_subnormal=False))


def test_degree_one():
    """t_10 = √(8π/3) ω_z, t^R_11 = −√(4π/3) ω_x, t^I_11 = +√(4π/3) ω_y, and the same for s ↔ g."""
    for kind, name in (("T", "rotation"), ("S", "glide")):
        c = Coefficients.from_vectors(**{name: (1, 2, 3)})
        found = [c.values[c.modes.index(mode)] for mode in (Mode(kind, 1, 0), Mode(kind, 1, 1), Mode(kind, 1, 1, "im"))]
        np.testing.assert_allclose(found, [3 * 2.8944050, -2.0466534, 2 * 2.0466534], rtol=3e-8)


def test_power_of_a_glide():
    """√P_1 = 2.894405 g, P_1 = (8π/3) g²."""
    c = Coefficients.from_vectors(glide=(0, 3, 4))
    assert np.sqrt(c.power("S", 1)) == pytest.approx(5 * 2.894405, rel=3e-7)
    assert c.power("T", 1) == 0


def test_power_is_the_integral():
    """∫ |V|² dΩ, by quadrature."""
    c = Coefficients(Modes(3), np.random.default_rng(0).normal(size=30))
    x, w = np.polynomial.legendre.leggauss(5)
    lon, lat = (g.ravel() for g in np.meshgrid(np.arange(9) * 2 * np.pi / 9, np.arcsin(x)))
    integral = np.sum(c.at(lon, lat) ** 2 * np.repeat(w, 9)) * 2 * np.pi / 9
    assert integral == pytest.approx(sum(c.power(kind, l) for kind in "TS" for l in (1, 2, 3)), rel=1e-12)


@pytest.mark.parametrize(("name", "mode", "factor"), [
    ("D1", ("S", 1, 1, "re"), -2.046653),
    ("D2", ("S", 1, 1, "im"), 2.046653),
    ("D3", ("S", 1, 0, "re"), 2.894405),
    ("R1", ("T", 1, 1, "re"), 2.046653),
    ("R2", ("T", 1, 1, "im"), -2.046653),
    ("R3", ("T", 1, 0, "re"), -2.894405),
    ("E20", ("S", 2, 0, "re"), np.sqrt(32 * np.pi / 15)),
    ("M20", ("T", 2, 0, "re"), np.sqrt(32 * np.pi / 15)),
    ("E21R", ("S", 2, 1, "re"), np.sqrt(4 * np.pi / 5)),
    ("M21I", ("T", 2, 1, "im"), np.sqrt(4 * np.pi / 5)),
    ("E22I", ("S", 2, 2, "im"), np.sqrt(16 * np.pi / 5)),
    ("M22R", ("T", 2, 2, "re"), np.sqrt(16 * np.pi / 5)),
])  # fmt: skip
def test_unit_amplitudes_of_icrf3(name, mode, factor):
    c = from_icrf3({name: 1.0})
    expected = np.zeros(len(c.modes))
    expected[c.modes.index(Mode(*mode))] = factor
    np.testing.assert_allclose(c.values, expected, atol=1e-6)


def icrf3_field(p, a, d):
    """Charlot et al. (2020), eq. 9, with Titov & Lambert's degree 2, written out."""
    sin, cos = np.sin, np.cos
    east = (
        p["R1"] * cos(a) * sin(d) + p["R2"] * sin(a) * sin(d) - p["R3"] * cos(d)
        - p["D1"] * sin(a) + p["D2"] * cos(a)
        + p["M20"] * sin(2 * d)
        - (p["M21R"] * cos(a) - p["M21I"] * sin(a)) * cos(2 * d)
        + (p["E21R"] * sin(a) + p["E21I"] * cos(a)) * sin(d)
        - (p["M22R"] * cos(2 * a) - p["M22I"] * sin(2 * a)) * sin(2 * d)
        - 2 * (p["E22R"] * sin(2 * a) + p["E22I"] * cos(2 * a)) * cos(d)
    )  # fmt: skip
    north = (
        -p["R1"] * sin(a) + p["R2"] * cos(a)
        - p["D1"] * cos(a) * sin(d) - p["D2"] * sin(a) * sin(d) + p["D3"] * cos(d)
        + p["E20"] * sin(2 * d)
        - (p["E21R"] * cos(a) - p["E21I"] * sin(a)) * cos(2 * d)
        - (p["M21R"] * sin(a) + p["M21I"] * cos(a)) * sin(d)
        - (p["E22R"] * cos(2 * a) - p["E22I"] * sin(2 * a)) * sin(2 * d)
        + 2 * (p["M22R"] * sin(2 * a) + p["M22I"] * cos(2 * a)) * cos(d)
    )  # fmt: skip
    return np.array([east, north])


def test_icrf3_names_mean_icrf3s_field():
    rng = np.random.default_rng(5)
    a, d = rng.uniform(0, 6, 40), rng.uniform(-1.5, 1.5, 40)
    parameters = dict(zip(ICRF3, rng.normal(size=16), strict=True))
    np.testing.assert_allclose(from_icrf3(parameters).at(a, d), icrf3_field(parameters, a, d), atol=1e-13)


@given(values)
def test_conversions_and_back(numbers):
    c = Coefficients(Modes(2), numbers)
    np.testing.assert_allclose(from_icrf3(to_icrf3(c)).values, numbers, rtol=1e-14)
    np.testing.assert_array_equal(from_healpy(to_healpy(c)).values, numbers)


def test_foreign_names_and_shapes_are_refused():
    with pytest.raises(ModesError, match="no parameter X1; it has R1, R2"):
        from_icrf3({"X1": 1})
    with pytest.raises(ModesError, match="not E and B"):
        from_healpy(np.zeros((2, 5)))


@pytest.mark.parametrize(
    ("n", "w", "mk", "exact"), [(3, 12, 2.4304, 2.4381), (5, 20, 2.9971, 3.0234), (7, 28, 3.4750, 3.5150)]
)
def test_significance(n, w, mk, exact):
    assert fit.spectrum.compute_wilson_hilferty_z(w, n) == pytest.approx(mk, abs=5e-5)
    assert fit.spectrum.normal_deviate(w, n) == pytest.approx(exact, abs=5e-5)


def test_galactic_acceleration_in_icrs():
    a = Vector([4.3, 0, 0], np.zeros((3, 3)), "galactic").to_frame("icrs")
    np.testing.assert_allclose(a.value, [-0.235965, -3.755779, -2.080491], atol=5e-7)


def test_units():
    assert pytest.approx(4.740470, abs=5e-7) == units.AU_PER_YEAR
    assert pytest.approx(0.6880253, abs=5e-8) == units.KM_S_MYR


def test_spin_and_acceleration_are_coupled_by_the_dipole_of_the_sources():
    """Equal weights: N_ωω = N_gg = Σ w (I − r rᵀ), N_ωg = [Σ w r]_×; correlation ≈ −(3/2)[r̄]_×."""
    n, tilt = 200_000, np.array([0.05, -0.08, 0.1])
    lon, lat = sim.uniform_sky(4 * n, rng=1)
    r = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    keep = np.random.default_rng(2).uniform(0, 1, 4 * n) < 0.25 * (1 + 3 * tilt @ r)
    population = sim.Population(lon[keep], lat[keep], None)
    r = r[:, keep]
    field = sim.observe(population, sim.spin((0, 0, 0)), rng=3, sigma=1.0)
    normal = fit.normal_equations(field, Modes(1))
    to_vectors = np.kron(np.eye(2), FIRST)
    matrix = to_vectors.T @ normal.matrix @ to_vectors
    total = r.sum(1)
    np.testing.assert_allclose(matrix[:3, :3], r.shape[1] * np.eye(3) - r @ r.T, atol=1e-6)
    np.testing.assert_allclose(matrix[3:, 3:], matrix[:3, :3], atol=1e-6)
    np.testing.assert_allclose(matrix[:3, 3:], cross(total), atol=1e-6)
    correlation = fit.solve_frame(field).correlation[:3, 3:]
    # Second order in the dipole, |r̄| = 0.14: 1.5² · 0.14² ≈ 0.04 of each element, and of each diagonal.
    np.testing.assert_allclose(correlation, -1.5 * cross(total / r.shape[1]), atol=0.01)
    assert np.abs(correlation).max() > 0.1


FIRST = np.sqrt(4 * np.pi / 3) * np.array([[0, 0, np.sqrt(2)], [-1, 0, 0], [0, 1, 0]])


def cross(v):
    """[v]_×"""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_errors_on_a_uniform_sky():
    """σ_ω = σ_g = √(3/(2N)) σ_µ per component."""
    n = 100_000
    population = sim.Population(*sim.uniform_sky(n, rng=1), None)
    solution = fit.fit_field(sim.observe(population, sim.spin((0, 0, 0)), rng=1, sigma=100.0), 1)
    # The sky itself is random: N of n points scatters by n^-½.
    for vector in (solution.spin, solution.acceleration):
        np.testing.assert_allclose(vector.sigma, np.sqrt(1.5 / n) * 100, rtol=0.02)


def test_reports_numbers_are_the_solutions():
    solution = fit.fit_field(random_field(500, seed=1), 2)
    text = solution.report(long=True)
    assert f"{solution.spin.value[0]:+.2f} ± {solution.spin.sigma[0]:.2f}" in text
    assert f"{solution.chi2:.6g}" in text


def test_vityazev_against_their_definition():
    """Real harmonics R_nk P_nk(sin δ) cos kα, sin kα and their gradients by differences; a field from their names."""
    from scipy.special import gammaln, lpmv

    rng, modes = np.random.default_rng(4), Modes(3)
    lon, lat = rng.uniform(0, 2 * np.pi, 20), rng.uniform(-1.2, 1.2, 20)
    ours = Coefficients(modes, rng.normal(size=len(modes)))
    east, north = np.zeros((2, 20))

    def real(n, k, p, lon, lat):
        size = np.sqrt((2 * n + 1) / (4 * np.pi) * (2 if k else 1) * np.exp(gammaln(n - k + 1) - gammaln(n + k + 1)))
        return size * (-1) ** k * lpmv(k, n, np.sin(lat)) * (np.cos(k * lon) if p else np.sin(k * lon))

    step = 1e-6
    for name, value in to_vityazev(ours).items():
        kind, (n, k, p) = name[0], map(int, name[2:].split("."))
        along = (real(n, k, p, lon + step, lat) - real(n, k, p, lon - step, lat)) / (2 * step * np.cos(lat))
        up = (real(n, k, p, lon, lat + step) - real(n, k, p, lon, lat - step)) / (2 * step)
        pair = (up, -along) if kind == "t" else (along, up)
        east += value / np.sqrt(n * (n + 1)) * pair[0]
        north += value / np.sqrt(n * (n + 1)) * pair[1]
    np.testing.assert_allclose([east, north], ours.at(lon, lat), atol=1e-7)
    np.testing.assert_allclose(from_vityazev(to_vityazev(ours)).values, ours.values, atol=1e-14)
    with pytest.raises(ModesError, match=r"no harmonic is called t_1\.2\.1"):
        from_vityazev({"t_1.2.1": 1.0})
