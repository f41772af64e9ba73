"""Pulsars and motions in one likelihood: overlap functions by brute force, Ω that was put in found by both."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.special import sph_harm_y

import fit
import sim
from fit.background import add_pulsars, wave_limit
from fit.pairs import waves_curve
from sim.pulsars import timing_noise
from vsh import Field, Mode, ParameterError, TableError
from vsh.models.waves import hellings_downs, timing_deflection, wave_coefficients
from vsh.sky.sphere import triad

YEARS, SLOPE, FREQUENCY = 3.0, 2 / 3, 1 / 15
#: ∫ Ω d ln f with f < 1/(3 yr) for h_c² = 1 at 1/(15 yr), with H0 = 70 km/s/Mpc a year: 7.159e-11.
BAND = 2 * np.pi**2 / 3 * (FREQUENCY / 7.1590e-11) ** 2 * (YEARS * FREQUENCY) ** -SLOPE / SLOPE


def redshift(k, h, p):
    return 0.5 * (p @ h @ p) / (1 + k @ p)


def deflection(k, h, r):
    return 0.5 * ((r + k) * (r @ h @ r) / (1 + k @ r) - h @ r)


@pytest.mark.parametrize("theta", [0.05, 1.2, 2.5])
def test_overlap_functions_by_brute_force(theta):
    """Means over waves from all directions in both polarisations, by quadrature: 1e-8."""
    pulsar, source = np.array([0.0, 0, 1]), np.array([np.sin(theta), 0, np.cos(theta)])
    away, across = np.array([np.cos(theta), 0, -np.sin(theta)]), np.array([0.0, 1, 0])

    def mean(product):
        def integrand(phi, c):
            s = np.sqrt(1 - c * c)
            k = np.array([s * np.cos(phi), s * np.sin(phi), c])
            south, east = np.array([c * np.cos(phi), c * np.sin(phi), -s]), np.array([-np.sin(phi), np.cos(phi), 0])
            tensors = np.outer(south, south) - np.outer(east, east), np.outer(south, east) + np.outer(east, south)
            return sum(product(k, h) for h in tensors) / (4 * np.pi)

        edges = (-1 + 1e-15, -np.cos(theta), 1 - 1e-15)  # where a wave comes from the source itself
        options = {"epsabs": 1e-10, "epsrel": 1e-10}
        return sum(
            dblquad(integrand, edges[i], edges[i + 1], j * np.pi, (j + 1) * np.pi, **options)[0]
            for i in range(2)
            for j in range(2)
        )

    unit = mean(lambda k, h: deflection(k, h, source) @ deflection(k, h, source))
    timing = mean(lambda k, h: redshift(k, h, pulsar) * redshift(k, h, source))
    along = mean(lambda k, h: redshift(k, h, pulsar) * (deflection(k, h, source) @ away))
    sideways = mean(lambda k, h: redshift(k, h, pulsar) * (deflection(k, h, source) @ across))
    assert timing / unit == pytest.approx(2 * hellings_downs(theta), abs=1e-8)
    assert along / unit == pytest.approx(timing_deflection(theta), abs=1e-8)
    assert sideways == pytest.approx(0.0, abs=1e-8)


def test_overlap_functions_at_their_ends():
    assert hellings_downs(0.0) == 0.5
    assert waves_curve(0.0) == 1.0
    np.testing.assert_allclose(hellings_downs([np.pi / 2, np.pi]), [3 / 4 * np.log(0.5) + 0.375, 0.25])
    np.testing.assert_allclose(timing_deflection([0.0, np.pi]), 0.0, atol=1e-12)
    assert timing_deflection(np.pi - 1e-5) == pytest.approx(0.0, abs=1e-4)


def test_redshifts_and_deflections_have_the_same_coefficients():
    """s_lm = −2/√(l(l + 1)) z_lm for a plus wave along z, by quadrature on the sphere."""
    x, weights = np.polynomial.legendre.leggauss(40)
    phi = np.arange(60) * 2 * np.pi / 60
    lat, lon = np.repeat(np.arcsin(x), 60), np.tile(phi, 40)
    r, k = triad(lon, lat)[2], np.array([0.0, 0, 1])
    h = np.diag([1.0, -1, 0])
    z = 0.5 * np.einsum("in,ij,jn->n", r, h, r) / (1 + k @ r)
    wave = wave_coefficients(k, 1.0, lmax=5)
    for l in range(2, 6):
        z_l2 = np.sum(np.repeat(weights, 60) * 2 * np.pi / 60 * z * np.conj(sph_harm_y(l, 2, np.pi / 2 - lat, lon)))
        s_l2 = wave.values[wave.modes.index(Mode("S", l, 2, "re"))]
        assert s_l2 == pytest.approx(-2 / np.sqrt(l * (l + 1)) * z_l2.real, rel=1e-10)


@pytest.fixture(scope="module")
def motions():
    def limit(omega, seed, n=1500, sigma=30.0):
        rng = np.random.default_rng(seed)
        lon, lat = sim.population.uniform_sky(n, rng)
        motion = sigma * rng.standard_normal((2, n))
        if omega:
            motion += sim.wave_background(omega, rng=rng)(lon, lat)
        return wave_limit(fit.normal_equations(Field(lon, lat, motion, np.full((2, n), sigma)), 2), noise_scale=False)

    return limit


def test_likelihood_is_that_of_wishart(motions):
    """Dense determinants on a few amplitudes, noise that differs by pulsar, a common factor integrated."""
    pairs = sim.pulsar_pairs(6, 2.0, 1.0, 3, bins=8)
    is_one = pairs["first"] == pairs["second"]
    pairs["noise"][is_one] = np.linspace(0.5, 2.0, 6)
    limit = motions(0.0, 1)
    flat = replace(limit, amplitude=fit.background.Amplitude(np.linspace(0, 50 * np.sqrt(BAND), 50), np.zeros(50)))
    found = add_pulsars(flat, pairs, YEARS, 8, frequency=FREQUENCY, slope=SLOPE)
    products, curve = np.zeros((6, 6)), np.zeros((6, 6))
    names = sorted(set(pairs["first"]))
    for row in pairs:
        i, j = names.index(row["first"]), names.index(row["second"])
        products[i, j] = products[j, i] = row["power"]
        curve[i, j] = curve[j, i] = 1.0 if i == j else hellings_downs(np.radians(row["angle"]))

    def dense(power):
        total = []
        for factor in np.geomspace(0.5, 2.0, 57):
            c = power * curve + factor * np.diag(np.linspace(0.5, 2.0, 6))
            total.append(-8 * (np.linalg.slogdet(c)[1] + np.trace(np.linalg.solve(c, products))))
        return np.logaddexp.reduce(total)

    powers = np.array([0.5, 1.0, 2.0, 4.0])
    expected = np.array([dense(each) for each in powers])
    logs = np.log(found.likelihood(powers * BAND))
    np.testing.assert_allclose(logs - logs[0], expected - expected[0], atol=2e-3)


def test_omega_is_found_by_both(motions):
    """Waves in motions and in pulsars: each alone finds them, both together more exactly; one note has the pulsars'."""
    omega = 0.6
    limit = motions(omega, 5)
    pairs = sim.pulsar_pairs(30, omega / BAND, 0.8 / BAND, 7)
    both = add_pulsars(limit, pairs, YEARS, 10, frequency=FREQUENCY, slope=SLOPE)
    assert limit.interval[0] < omega < limit.interval[1]
    assert both.interval[0] < omega < both.interval[1]
    assert np.ptp(both.interval) < np.ptp(limit.interval)
    assert both.maximum == pytest.approx(omega, rel=0.4)
    note = both.notes[-1]
    assert note.startswith("waves: with 30 pulsars at 0.0667 per year, which alone give h70² Ω = ")
    assert note in both.report()
    assert "f < 1/T = 10.6 nHz" in both.report()
    # Ω at the frequency itself, by the definition of h_c.
    ratio = float(note.split(" it is ")[1].split(" times")[0])
    assert ratio == pytest.approx(2 * np.pi**2 / 3 * (FREQUENCY / 7.159e-11) ** 2 / BAND, rel=5e-3)


@pytest.mark.parametrize("slope", [-1.0, 0.0, 1e-9, 2 / 3])
def test_band_of_a_power_law(motions, slope):
    """∫ Ω d ln f over the band of the motions by quadrature, in the ratio that the note has."""
    limit = add_pulsars(motions(0.0, 1), sim.pulsar_pairs(3, 1.0, 1.0, 1), 3.0, 10, slope=slope, lowest=1e-3)
    f = np.geomspace(1e-3, 1 / 3, 20_001)
    share = np.sum((f[1:] ** slope + f[:-1] ** slope) / 2 * np.diff(np.log(f)))
    assert float(limit.notes[-1].split(" it is ")[1].split(" times")[0]) == pytest.approx(1 / share, rel=5e-3)


@pytest.mark.slow
def test_intervals_and_limits_hold(motions):
    """200 skies each of weak and strong waves: 68 % and 95 %, from both together."""
    for size in (1.0, 4.0):
        omega, held = size * 0.054, []
        for sky in range(200):
            pairs = sim.pulsar_pairs(30, omega / BAND, 0.73 / BAND, [sky, 1])
            both = add_pulsars(motions(omega, [sky, 2]), pairs, YEARS, 10, frequency=FREQUENCY, slope=SLOPE)
            held.append((both.interval[0] <= omega <= both.interval[1], omega <= both.limit()))
        share = np.mean(held, 0)
        assert 0.6 < share[0] < 0.82
        assert share[1] > 0.93


def test_tables_that_cannot_be_used(motions, tmp_path):
    limit, pairs = motions(0.0, 1), sim.pulsar_pairs(5, 1.0, 1.0, 1)
    pairs.write(tmp_path / "pairs.ecsv")
    one, two = (add_pulsars(limit, each, 3.0, 10) for each in (pairs, tmp_path / "pairs.ecsv"))
    assert one.limit() == two.limit()
    with pytest.raises(TableError, match="no column 'noise'"):
        add_pulsars(limit, pairs["first", "second", "angle", "power"], 3.0, 10)
    with pytest.raises(ParameterError, match="15 rows in all: 1 are missing"):
        add_pulsars(limit, pairs[1:], 3.0, 10)
    pairs["noise"][0] = -1.0
    with pytest.raises(ParameterError, match="1 of 15 rows have no angle, power, or noise above zero"):
        add_pulsars(limit, pairs, 3.0, 10)
    with pytest.raises(ParameterError, match=r"f\^-1 from 0 to 0.333333 per year has no finite energy"):
        add_pulsars(limit, pairs, 3.0, 10, slope=-1.0)
    with pytest.raises(ParameterError, match="two pulsars"):
        sim.pulsar_pairs(1, 1.0, 1.0, 1)


def test_noise_of_residuals_as_strain():
    """12 π² f³ × 2 σ² Δt: 100 ns every two weeks at 1 per year, by hand."""
    f = 1 / (365.25 * 86400)
    assert timing_noise(100.0, 14.0, 1.0) == pytest.approx(12 * np.pi**2 * f**3 * 2 * 1e-14 * 14 * 86400)
