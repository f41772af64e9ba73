"""Templates on simulated skies: what eight maps do to spin and acceleration, and whether an amplitude comes back.

    python benchmarks/templates.py [SKIES]

1500 places outside the Galactic plane that stand for 1.2 million quasars; systematics of degrees 1 to 12. Eight maps of
power ∝ l⁻² to degree 12 are in the motions with 12 and 4 µas/yr (the first two) or not at all. "cut" are templates
cut to degree 5, with the fit; "whole" is all to degree 12, where the maps end (60 skies at most).
"""

import sys

import numpy as np

import sim
from fit.background import SHAPES, shared
from fit.normal import NormalEquations, TemplateField
from vsh import Coefficients, Modes
from vsh.basis import harmonics

FULL, LMAX = Modes(12), 5
N_DATA = 400_000


class Sky:
    """Normal equations of one coverage to degree 12, and of the maps themselves."""

    def __init__(self, seed=5):
        self.rng = np.random.default_rng(seed)
        lon, lat = sim.plane_avoiding_sky(1500, self.rng)
        basis = harmonics(lon, lat, FULL)
        root = np.sqrt(2.2 * 1500 / 4 / np.pi)
        self.maps = []
        for _ in range(8):
            values = self.rng.normal(size=len(FULL)) / FULL.degrees * np.sqrt(1 / FULL.norm2)
            self.maps.append(values / np.sqrt(values**2 @ FULL.norm2 / (4 * np.pi)))
        rows = basis.reshape(len(FULL), -1) / root
        self.matrix = rows @ rows.T
        values, vectors = np.linalg.eigh(self.matrix)
        self.root = vectors * np.sqrt(np.maximum(values, 0))

    def observed(self, coefficients, rng):
        noise = self.root @ rng.normal(size=len(FULL))
        rhs = self.matrix @ coefficients + noise
        chi2 = coefficients @ self.matrix @ coefficients + 2 * coefficients @ noise + rng.chisquare(N_DATA)
        return rhs, float(chi2)

    def equations(self, rhs, chi2, kind):
        """To degree 5 without templates or with them cut, or all to degree 12."""
        modes = FULL if kind == "whole" else Modes(LMAX)
        at = np.flatnonzero(FULL.degrees <= modes.lmax)
        fields = []
        for k, each in enumerate(self.maps if kind != "none" else []):
            values = Coefficients(FULL, each).to_degree(modes.lmax).values
            fields.append(TemplateField(str(k), values / np.sqrt(values**2 @ modes.norm2 / (4 * np.pi))))
        matrix = self.matrix[np.ix_(at, at)]
        return NormalEquations(modes, matrix, rhs[at], chi2, N_DATA, "icrs", templates=tuple(fields))


def covers(pulls):
    size = np.abs(np.array(pulls))
    return f"{np.sqrt(np.mean(size**2)):5.2f}  {np.mean(size < 1.96):.3f}"


def main(skies=200):
    sky = Sky()
    flat = 20.0 * SHAPES["flat"].only("odd") + 5.0 * SHAPES["flat"].only("even")
    variances = np.where(FULL.degrees <= 12, flat.variances(FULL), 0.0)
    print("degree 1: pull, 95 %; bias, rms and quoted error [µas/yr, coefficients]")
    for name, power, amounts in (
        ("no systematics, maps in it", 0.0, (6.0, 2.0)),
        ("flat systematics, maps in it", 1.0, (12.0, 4.0)),
        ("flat systematics, maps not in it", 1.0, (0.0, 0.0)),
    ):
        out = {"none": [], "cut": [], "whole": []}
        for seed in range(skies):
            rng = np.random.default_rng([8, seed])
            systematics = rng.normal(size=len(FULL)) * np.sqrt(power * variances)
            pushed = systematics + sum(a * m for a, m in zip(amounts, sky.maps, strict=False))
            rhs, chi2 = sky.observed(pushed, rng)
            for kind, rows in out.items():
                if kind == "whole" and seed >= 60:
                    continue
                result = shared([sky.equations(rhs, chi2, kind)], draws=100, rng=seed)
                rows.append((result.values[0], np.sqrt(np.diag(result.covariance))))
        for kind, rows in out.items():
            values, errors = np.array(rows).transpose(1, 0, 2)
            bias, rms = np.sqrt(np.mean(values.mean(0) ** 2)), np.sqrt(np.mean(values**2))
            quoted = np.sqrt(np.mean(errors**2))
            print(f"{name:34}{kind:6}{covers(values / errors)}{bias:8.2f}{rms:8.2f}{quoted:8.2f}", flush=True)
    print("an amplitude of the first map, free beside flat systematics, in its errors")
    for size in (0, 3, 10):
        pulls, unit = [], None
        for seed in range(skies):
            rng = np.random.default_rng([9, seed])
            systematics = rng.normal(size=len(FULL)) * np.sqrt(variances)
            cut = Coefficients(FULL, sky.maps[0]).to_degree(LMAX)
            scale = np.sqrt(cut.values**2 @ Modes(LMAX).norm2 / (4 * np.pi))
            if unit is None:
                rhs, chi2 = sky.observed(systematics, rng)
                equations = sky.equations(rhs, chi2, "cut")
                unit = np.sqrt(shared([equations], draws=100, rng=1).amplitude_covariance[0, 0])
                rng = np.random.default_rng([9, seed])
                systematics = rng.normal(size=len(FULL)) * np.sqrt(variances)
            rhs, chi2 = sky.observed(systematics + size * unit / scale * sky.maps[0], rng)
            result = shared([sky.equations(rhs, chi2, "cut")], draws=100, rng=seed)
            error = np.sqrt(result.amplitude_covariance[0, 0])
            pulls.append((result.amplitudes[0] - size * unit) / error)
        print(f"{size:4} errors: back to {np.mean(pulls):+.2f} of its error, pull and 95 % {covers(pulls)}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
