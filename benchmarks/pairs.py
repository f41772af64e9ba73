"""Pairs without counting them: beside TreeCorr, and a Monte Carlo of gravitational waves with errors that are wrong.

python benchmarks/pairs.py speed     # a million sources here, a hundred thousand there, in one run
python benchmarks/pairs.py waves 150 # skies of 5000 sources, errors of 20 for noise of 30 µas/yr, Ω = 0.05
"""

import sys
import time

import numpy as np

import fit
import sim
from fit import pairs
from vsh import Field
from vsh.tools.units import hubble_rate

EDGES = np.radians(np.arange(0, 181, 12.0))


def sky(n, rng, lowest=-0.7):
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(lowest, 1, n))
    return lon, lat


def speed():
    import treecorr

    rng = np.random.default_rng(1)
    many = Field(*sky(1_000_000, rng), 100 * rng.normal(size=(2, 1_000_000)), np.full((2, 1_000_000), 100.0))
    few = many[:100_000]
    pairs.correlation_function(few, EDGES, lmax=120, threads=1)  # imports and windows
    start = time.process_time()
    pairs.correlation_function(many, EDGES, lmax=120, threads=1)
    ours = time.process_time() - start
    catalogue = treecorr.Catalog(
        ra=few.lon, dec=few.lat, ra_units="rad", dec_units="rad", v1=-few.motion[0], v2=few.motion[1]
    )
    theirs = treecorr.VVCorrelation(
        bin_type="Linear", min_sep=0, max_sep=180, nbins=15, sep_units="deg", metric="Arc", num_threads=1
    )
    start = time.process_time()
    theirs.process(catalogue)
    other = time.process_time() - start
    print(
        f"{len(many)} sources here: {ours:.2f} CPU s; {len(few)} in TreeCorr: {other:.1f} CPU s; ratio {ours / other:.3f}"
    )


def waves(skies):
    rng = np.random.default_rng(8)
    lon, lat = sky(5000, rng, -0.6)
    edges, omega = np.radians(np.arange(0, 181, 9.0)), 0.05
    quoted = np.full((2, 5000), 20.0)
    factor = 6 / 5 / (4 * np.pi * hubble_rate(70) ** 2)
    found = []
    for _ in range(skies):
        signal = sim.wave_background(omega, rng, lmax=10)(lon, lat) + sim.spin((3, 0, 1))(lon, lat)
        field = Field(lon, lat, signal + 30 * rng.normal(size=(2, 5000)), quoted)
        fitted = pairs.correlation_function(field, edges, lmax=160).fit(("waves", "spin"))
        solution = fit.fit_field(field, 3)
        scaled = fit.fit_field(field.with_errors(quoted * np.sqrt(solution.reduced_chi2)), 3)
        found.append([*fitted["waves"], *(factor * (s.power("T", 2) + s.power("S", 2)) for s in (solution, scaled))])
    found = np.array(found)
    print(f"Ω = {omega}, {skies} skies of 5000 sources")
    for name, column in (
        ("pairs, curve of waves", 0),
        ("power of degree 2 less quoted noise", 2),
        ("less scaled noise", 3),
    ):
        values = found[:, column]
        print(f"  {name:38}{values.mean():.4f} ± {values.std() / np.sqrt(skies):.4f}, scatter {values.std():.4f}")
    print(f"  error quoted by pairs, rms{'':14}{np.sqrt(np.mean(found[:, 1] ** 2)):.4f}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["waves"]:
        waves(int(sys.argv[2]) if len(sys.argv) > 2 else 150)
    else:
        speed()
