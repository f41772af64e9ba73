"""Write docs/validation.md from what the tests against outside truths see.

Run as `python docs/make_validation.py` with the test environment; real catalogues are used where they
are at hand.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = [
    *sorted(f"against/{path.name}" for path in (ROOT / "tests" / "against").glob("test_*.py")),
    "vsh/test_conventions.py",
    "study/test_effects.py",
]
HEAD = """# Validation

What comes from outside this project and how well we agree with it: the largest difference that each test saw, absolute in
the unit of the quantity (radians, µas, µas/yr, or a pure number) and relative to the largest value. Written by
`docs/make_validation.py` from the test results; `make test` runs the same tests.

"""
#: Coverage on simulated skies, as the benchmarks printed it.
TAIL = "\n" + (ROOT / "benchmarks" / "coverage.md").read_text(encoding="utf-8")


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "agreement.jsonl"
        tests = [str(ROOT / "tests" / name) for name in FILES]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "--agreement", str(path), *tests]
        done = subprocess.run(command, cwd=ROOT, check=False)
        if done.returncode:
            sys.exit("the tests do not pass: nothing was written")
        rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    (ROOT / "docs" / "validation.md").write_text(HEAD + table(rows) + TAIL, encoding="utf-8")


def table(rows):
    lines = []
    for file in FILES:
        mine = [row for row in rows if row["file"] == Path(file).name]
        if not mine:
            continue
        lines += [f"## {mine[0]['truth']}", "", f"`tests/{file}`", "", "| test | comparisons | largest difference | relative |",
                  "|---|---|---|---|"]  # fmt: skip
        for row in mine:
            words = row["test"].removeprefix("test_").replace("_", " ")
            if row["comparisons"]:
                lines.append(f"| {words} | {row['comparisons']} | {row['absolute']:.1e} | {row['relative']:.1e} |")
            else:
                lines.append(f"| {words} | | agrees within its stated errors | |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
