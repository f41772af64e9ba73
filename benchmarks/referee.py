"""The referee on skies whose truth is known: no acceleration, no spin, nothing that changes with anything.

    python benchmarks/referee.py 200 [case …]

For each verdict and check how often p < .05 and < .0027, by the errors quoted and with what sources share; how often 68 %
of a component of g and of the spin hold the truth.
"""

import sys

import numpy as np
from astropy.table import Table

import sim
from study.referee import read_quasars, referee
from vsh import Field
from vsh.io.catalogue import read_field
from vsh.models.covariance import LINDEGREN_2021, Spectrum

#: Sources with five parameters; the published systematics so many times as large: three times the noise.
SOURCES, SIZE = 3000, 8.0


def sky(case: str, seed: int, table: Table, base: Field) -> Table:
    """One catalogue of a case."""
    rng = np.random.default_rng([seed, sum(map(ord, case))])
    n, motion = len(base), np.zeros((2, len(base)))
    draw = rng.standard_normal((2, n))
    if case == "tails":
        draw = rng.standard_t(3, (2, n))
    noise = np.stack([draw[0], base.rho * draw[0] + np.sqrt(1 - base.rho**2) * draw[1]]) * base.sigma
    if case == "faint":  # errors half as large again for the fainter half
        noise = noise * np.where(base.magnitude > np.median(base.magnitude), 1.5, 1.0)
    shape = {"flat": 500 * Spectrum.flat()}.get(case, SIZE**2 * Spectrum.from_covariance(LINDEGREN_2021))
    if case in ("flat", "gaia", "classes", "tails"):
        motion = sim.systematics(shape, rng)(base.lon, base.lat)
    if case == "classes":  # by magnitude and by colour, beside what all share
        for values in (base.magnitude, np.asarray(table["nu_eff_used_in_astrometry"], float)):
            own = sim.systematics(shape, rng)(base.lon, base.lat)
            motion = 0.7 * motion + 0.7 * own * np.where(values > np.nanmedian(values), 1.0, 0.3)
    if case == "stars":
        stars = rng.random(n) < 0.005
        motion[:, stars] += rng.standard_normal((2, stars.sum())) * 3000
    made = table.copy()
    made["pmra"], made["pmdec"] = (motion + noise) / 1000
    return made


def main(n: int, cases: list[str]) -> None:
    """Print a table for each case."""
    for case in cases:
        p, face, held = {}, {}, {"acceleration": [], "spin": []}
        for seed in range(n):
            table = sim.crf3(seed, sim.spin((0, 0, 0)), n_five=SOURCES)
            answer = referee(read_quasars(sky(case, seed, table, read_field(table))), seed)
            for each in (*answer.sections, *answer.checks):
                name = getattr(each, "key", "") or each.title
                p.setdefault(name, []).append(each.p_value)
                face.setdefault(name, []).append(getattr(each, "at_face_value", np.nan))
            p.setdefault("smallest, times number", []).append(answer.smallest[1])
            for name, away in held.items():
                vector = getattr(answer.headline.solution, name)
                away.extend(np.abs(vector.value) < vector.sigma)
        print(f"\n{case}: {n} skies, 68 %: g {np.mean(held['acceleration']):.3f}, spin {np.mean(held['spin']):.3f}")
        for name, values in p.items():
            known = np.array(values)[np.isfinite(values)]
            quoted = np.array(face.get(name, []))
            quoted = quoted[np.isfinite(quoted)]
            if len(known):
                more = f"   quoted {np.mean(quoted < 0.05):.3f} {np.mean(quoted < 0.0027):.3f}" if len(quoted) else ""
                print(f"  {name:56}{np.mean(known < 0.05):7.3f} {np.mean(known < 0.0027):7.4f}{more}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:] or ["noise", "flat", "gaia", "classes", "faint", "tails", "stars"])
