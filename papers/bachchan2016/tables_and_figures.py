"""The paper's tables and figures from a study of its four cases, and the two side by side.

    python papers/bachchan2016/realisations.py paper
    python papers/bachchan2016/tables_and_figures.py paper

`make paper` does both.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import fdtr, fdtrc, ndtri, stdtr

import fit
from effects import attractions, effects
from figures import write_figures
from published import ATTRACTIONS, CORRELATIONS, EFFECTS, EXPERIMENTS, SPEED_ERRORS, SPEEDS, published
from realisations import load, prepare, read_realisations, summary
from vsh import Field, Vector
from vsh.io import tables
from vsh.tools.files import atomic_write

#: Quantities that were set to the paper's, which agree with it by construction (marked † in the tables).
_TUNED = {
    "⟨σ⟩ of ω and ã": "the factor 0.886 on a transit's error (`sim.astrometry.RELEASES`), set to case A",
    "⟨σ⟩ of v, H0 and the galaxies' ã": "`excess = 215` µas a transit of galaxies (`papers/bachchan2016/study.toml`), set to case A",
    "correlations of ω with ã": "`sim.skies.GUMS_PLANE` (case A) and `IGQL_SHARES` (case D), set to the paper's Table 6",
}


def write_paper(study: Mapping[str, Any], folder: Path, n_realisations: int, draw: bool = True) -> None:
    """Write tables.md, tables.ecsv, comparison.md and the figures into the folder of a finished study."""
    folder = Path(folder)
    rows = summary(study, read_realisations(study, folder, n_realisations))
    correlations = {name: _correlation(study, folder, name) for name in ("A", "D")}
    _write_text(folder / "tables.md", _tables(rows, correlations, n_realisations))
    tables.write_columns(
        folder / "tables.ecsv",
        {key: [row[key] for row in rows] for key in rows[0]},
        {"realisations": n_realisations},
        overwrite=True,
    )
    _write_text(folder / "comparison.md", _comparison(rows, correlations, n_realisations))
    if draw:
        write_figures(study, folder)


def _write_text(path, text):
    with atomic_write(path, overwrite=True) as new:
        new.write_text(text, encoding="utf-8")


def _correlation(study, folder, name):
    """The formal (9, 9) correlation matrix of ε, ω and ã for one case."""
    case = next(case for case in study["case"] if case["name"] == name)
    fields = []
    for kind in ("quasars", "vlbi"):
        with np.load(prepare(study, case, kind, folder / "prepared")) as file:
            still = np.zeros_like(file["sigma"])
            fields.append(
                Field(file["lon"], file["lat"], still, file["sigma"], file["rho"], frame=study["study"]["frame"])
            )
    return fit.solve_frame(*fields).correlation


def _by_case(rows):
    found = {}
    for row in rows:
        found.setdefault(row["case"], {})[row["parameter"]] = row
    return found


def _tables(rows, correlations, n_realisations):
    seen = [row for row in rows if row["parameter"].endswith("@seen")]
    rows = [row for row in rows if not row["parameter"].endswith("@seen")]
    lines = ["# Tables", "", "As in the paper, redshifts are perfect: they hold neither peculiar velocities nor our own. The same cases with",
             "redshifts as they are seen stand at the end.", "", f"{n_realisations} realisations of each case. Galactic axes; ε in µas, ω and ã in µas/yr, v in km/s toward the",
             "apex, H0 in km/s/Mpc. `@1` and `@3`: by vector spherical harmonics to that degree; without: by the direct frame solver.", ""]  # fmt: skip
    lines += ["## Effects", "", "| effect | here [µas/yr] | paper |", "|---|---|---|"]
    for name, (low, high) in effects().items():
        lines.append(f"| {name} | {low:.3g}{'' if low == high else f' – {high:.3g}'} | {EFFECTS[name]} |")
    lines += ["", "## Accelerations by galaxies and clusters", "", "| | here [µas/yr] | paper |", "|---|---|---|"]
    lines += [f"| {name} | {value:.1e} | {ATTRACTIONS[name]:.1e} |" for name, value in attractions().items()]
    for case, table in _by_case(rows).items():
        lines += [
            "",
            f"## Case {case}",
            "",
            "| parameter | truth | mean | Std | ⟨σ⟩ | off, in s.e. |",
            "|---|---|---|---|---|---|",
        ]
        for name, row in table.items():
            lines.append(
                f"| {name} | {row['truth']:.3f} | {row['mean']:.3f} | {row['std']:.3f} | {row['sigma']:.3f} | {row['off']:+.1f} |"
            )
        if "v_x" in table:
            speed, l, b = _antapex(table)
            lines.append(
                f"| length of the mean v; antapex l, b | 369.0; 83.99°, −48.26° | {speed:.1f}; {l:.2f}°, {b:.2f}° | | | |"
            )
    lines += ["", "## Correlations: case A (GUMS-like) above the diagonal, case D (IGQL-like) below", ""]
    names = [f"{v}_{axis}" for v in ("ε", "ω", "ã") for axis in "xyz"]
    both = np.triu(correlations["A"], 1) + np.tril(correlations["D"], -1) + np.eye(9)
    lines += ["| | " + " | ".join(names) + " |", "|---" * 10 + "|"]
    lines += [
        f"| {name} | " + " | ".join(f"{x:+.3f}" for x in row) + " |" for name, row in zip(names, both, strict=True)
    ]
    return "\n".join([*lines, *_seen_lines(seen)]) + "\n"


def _seen_lines(rows):
    """The cases with redshifts as they are seen."""
    if not rows:
        return []
    lines = ["", "## Redshifts as they are seen", "",
             "Heliocentric, with the galaxies' own velocities in them; distances from redshifts and magnitudes (`fit.distances`). Galaxies",
             "with z < 0.001 at rest in the microwave background are left out.", "",
             "| case | parameter | truth | mean | Std | ⟨σ⟩ | off, in s.e. |", "|---|---|---|---|---|---|---|"]  # fmt: skip
    for row in rows:
        lines.append(
            f"| {row['case']} | {row['parameter'].removesuffix('@seen')} | {row['truth']:.3f} | {row['mean']:.3f} | {row['std']:.3f} | "
            f"{row['sigma']:.3f} | {row['off']:+.1f} |"
        )
    return lines


def _antapex(table):
    away = Vector([-table[f"v_{axis}"]["mean"] for axis in "xyz"], np.zeros((3, 3)), "galactic")
    return away.amplitude, *away.direction


def _comparison(rows, correlations, n_realisations):
    lines = [
        "# The paper's numbers and ours", "", "Redshifts are perfect here, as in the paper.", "",
        f"Bachchan, Hobbs & Lindegren (2016, A&A 589, A71), {EXPERIMENTS} experiments, beside {n_realisations} realisations. Means and standard",
        "deviations differ by so many normal deviates σ, those of Student's t and of Fisher's F with the numbers of realisations; formal errors,",
        "which hardly have a Monte Carlo error, by per cent.",
        "Where they differ by more than 3, or 15 %, the last column says what is known of it.", "",
        "Numbers marked † were set to the paper's, and do not test anything:", "",
        *(f"* {what}: {how}." for what, how in _TUNED.items()), "",
        "Not simulated: the random motion of 10 µas/yr that the paper gives each quasar. Added in quadrature to the errors of",
        "G = 20 (268 µas/yr) it makes 0.07 % of a difference.", "",
        "The galaxies' fit takes the spin of the quasars as known, without its error, as the paper did (`propagate_spin = false`): its errors",
        "of v and H0 are too small by what that spin adds, which is little for 500 000 quasars. `propagate_spin = true` in study.toml includes it.", "",
    ]  # fmt: skip
    for case, table in _by_case(rows).items():
        lines += [
            f"## Case {case}",
            "",
            "| parameter | what | paper | here | difference | why |",
            "|---|---|---|---|---|---|",
        ]
        for name, (mean, std, sigma) in published(case).items():
            if name not in table:
                continue
            row = table[name]
            off = _deviate_of_means(row["mean"] - mean, row["std"], n_realisations, std)
            spread = _deviate_of_scatters(row["std"], n_realisations, std)
            ratio = row["sigma"] / sigma - 1
            for what, theirs, ours, shown, large in (
                ("mean", mean, row["mean"], f"{off:+.1f} σ", abs(off) > 3),
                ("Std", std, row["std"], f"{spread:+.1f} σ", abs(spread) > 3),
                ("⟨σ⟩", sigma, row["sigma"], f"{100 * ratio:+.0f} %", abs(ratio) > 0.15),
            ):
                why = _why(case, name, what, std / sigma, row["std"] / row["sigma"]) if large else ""
                shown += " †" if what == "⟨σ⟩" and not name.startswith("epsilon") else ""
                lines.append(f"| {name} | {what} | {theirs:.3f} | {ours:.3f} | {shown} | {why} |")
        if "v_x" in table:
            for what, theirs, ours in zip(
                ("length of v", "l of the antapex", "b of the antapex"), SPEEDS[case], _antapex(table), strict=True
            ):
                lines.append(f"| {what} | mean vector | {theirs:.2f} | {ours:.2f} | {ours - theirs:+.2f} | |")
            for what, key, theirs in zip(("Std", "⟨σ⟩"), ("std", "sigma"), SPEED_ERRORS[case], strict=True):
                ours = float(np.sqrt(sum(table[f"v_{axis}"][key] ** 2 for axis in "xyz")))
                lines.append(
                    f"| length of v | {what} | {theirs:.1f} | {ours:.1f} | {100 * (ours / theirs - 1):+.0f} % "
                    "| the components' in quadrature, here as in the paper |"
                )
        lines.append("")
    lines += _compared_correlations(correlations)
    lines += ["## Accelerations by galaxies and clusters", "", "| | paper | here | why |", "|---|---|---|---|"]
    for name, value in attractions().items():
        why = (
            "the printed mass and distance do not give the printed value"
            if f"{value:.1e}" != f"{ATTRACTIONS[name]:.1e}"
            else ""
        )
        lines.append(f"| {name} | {ATTRACTIONS[name]:.1e} | {value:.1e} | {why} |")
    lines += ["", "## Effects", "", "| effect | paper | here | why |", "|---|---|---|---|"]
    reasons = {
        "anisotropic expansion by 1 %": "ours is 1 % of H0; the paper's is of a model of Quercellini et al. (2009)",
        "off-centre void": "the paper's own number, not solved here",
        "weak microlensing, rms": "ours is the mean over all quasars; tens of µas/yr are for the very few that are lensed",
        "peculiar proper motion": "600 to 1500 km/s at z = 0.01",
    }
    for name, (low, high) in effects().items():
        lines.append(
            f"| {name} | {EFFECTS[name]} | {low:.3g}{'' if low == high else f' – {high:.3g}'} | {reasons.get(name, '')} |"
        )
    return "\n".join(lines) + "\n"


def _compared_correlations(correlations):
    both = np.triu(correlations["A"], 1) + np.tril(correlations["D"], -1) + np.eye(9)
    names = [f"{v}_{axis}" for v in ("epsilon", "omega", "a") for axis in "xyz"]
    lines = ["## Correlations", "", "Formal, so without Monte Carlo error. A above the diagonal of the paper's Table 6, D below.", "",
             "| case | pair | paper | here | difference | why |", "|---|---|---|---|---|---|"]  # fmt: skip
    for i in range(9):
        for j in range(9):
            if i == j or CORRELATIONS[i, j] == both[i, j] == 0:
                continue
            difference = both[i, j] - CORRELATIONS[i, j]
            large = abs(difference) > 0.06
            mark = " †" if {i // 3, j // 3} == {1, 2} else ""
            why = ""
            if large:
                why = (
                    "within one vector: the scanning law's errors differ along α and δ; the paper's hardly seem to"
                    if i // 3 == j // 3
                    else "the sky model: its shares are set to the whole block, not to each element"
                )
            lines.append(
                f"| {'A' if i < j else 'D'} | {names[i]}, {names[j]} | {CORRELATIONS[i, j]:+.3f} | {both[i, j]:+.3f} | {difference:+.3f}{mark} | {why} |"
            )
    return [*lines, ""]


def _deviate_of_means(difference, scatter, n, std):
    """A difference of two means as a normal deviate, by Welch's t: the scatter of few realisations is not known well."""
    ours, theirs = scatter**2 / max(n, 1), std**2 / EXPERIMENTS
    dof = (ours + theirs) ** 2 / (ours**2 / max(n - 1, 1) + theirs**2 / (EXPERIMENTS - 1))
    return float(np.sign(difference) * -ndtri(stdtr(dof, -abs(difference) / np.sqrt(ours + theirs))))


def _deviate_of_scatters(scatter, n, std):
    """A difference of two standard deviations as a normal deviate, by Fisher's F."""
    if n < 2:
        return 0.0
    ratio = (scatter / std) ** 2
    upper, lower = fdtrc(n - 1, EXPERIMENTS - 1, ratio), fdtr(n - 1, EXPERIMENTS - 1, ratio)
    return float(-ndtri(upper) if upper < lower else ndtri(lower))


def _why(case, name, what, theirs, ours):
    """What is known of a difference: numbers of the two rows, or what the paper does not tell."""
    if what == "Std":
        return f"Std/⟨σ⟩ is {theirs:.2f} there and {ours:.2f} here"
    if case == "D" and what == "mean" and name.startswith(("omega", "a_", "epsilon")):
        return "not reproduced: see docs/theory.md"
    if name.startswith("epsilon") and what == "⟨σ⟩":
        return "the paper does not tell the magnitudes of its 3300 sources"
    return "not explained"


def main() -> None:
    """What `make paper` runs when the study is done."""
    parser = argparse.ArgumentParser(description="Write the paper's tables and figures into the folder of its study.")
    parser.add_argument("folder", type=Path, help="that of realisations.py")
    parser.add_argument("--n-realisations", type=int, help="of the study; its configuration's unless given")
    parser.add_argument("--no-figures", action="store_true", help="tables only")
    options = parser.parse_args()
    study = load()
    write_paper(
        study, options.folder, options.n_realisations or study["study"]["n_realisations"], draw=not options.no_figures
    )
    print((options.folder / "tables.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
