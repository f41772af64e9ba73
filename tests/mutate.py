"""Break the code in the places that matter most, one at a time, in a copy: does a test find each?

`python tests/mutate.py` plants every break, runs the tests named beside it and prints which were found; it ends
with status 1 if one was not, or if a place to break is not there any more. `python tests/mutate.py 3 7` runs some.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from breaks import BREAKS

ROOT = Path(__file__).resolve().parents[1]


def _path_of(test):
    """Where a file of tests is, perhaps with the name of one of its tests."""
    name, *rest = test.split("::")
    found = next((ROOT / "tests").rglob(name)).relative_to(ROOT).as_posix()
    return "::".join([found, *rest])


def main(chosen=()):
    chosen = set(chosen) or set(range(len(BREAKS)))
    lost = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        ignored = shutil.ignore_patterns(".venv*", ".git", "__pycache__", "paper", "demo", ".hypothesis")
        shutil.copytree(ROOT, copy, ignore=ignored)
        environment = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
        for number in sorted(chosen):
            name, old, new, tests = BREAKS[number]
            path = copy / name
            whole = path.read_text(encoding="utf-8")
            if whole.count(old) < 1:
                print(f"{number:3} {name}: {old!r} is not there any more")
                lost.append(number)
                continue
            path.write_text(whole.replace(old, new, 1), encoding="utf-8")
            paths = [_path_of(each) for each in tests.split()]
            command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-n", "2", *paths]
            # The quick tests first; what none of them sees a slow one has to.
            for which in [["-m", "not slow"]] * ("::" not in tests) + [[]]:
                done = subprocess.run(
                    [*command, *which], cwd=copy, env=environment, capture_output=True, text=True, check=False
                )
                if found := re.search(r"\d+ failed", done.stdout) is not None:
                    break
            path.write_text(whole, encoding="utf-8")
            if not found and done.returncode:
                print(done.stdout[-2000:], done.stderr[-2000:])
            print(f"{number:3} {'found' if found else 'NOT FOUND':10} {name}: {old!r} → {new!r}", flush=True)
            if not found:
                lost.append(number)
    print(f"{len(chosen) - len(lost)} of {len(chosen)} deliberate breaks found")
    return bool(lost)


if __name__ == "__main__":
    sys.exit(main(map(int, sys.argv[1:])))
