"""The wheel as a user has it: installed in an empty environment, used from a folder with a fit.py, a sim/ and a study.py.

python tests/wheel.py dist
"""

import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

#: What a user does first.
JOBS = (
    "vsh-fit --demo --output demo --html demo.html",
    "vsh-sim quasars --number 500 --output q.fits",
    "vsh-sim galaxies --number 500 --errors expected --output g.fits",
    "vsh-fit q.fits --json",
    "vsh-redshift g.fits --on-bad drop --bins 2",
    "vsh-correlate q.fits",
    "vsh-pairs q.fits",
    "vsh-compare q.fits q.fits",
    "vsh-referee q.fits --output referee --format none",
    "vsh-forecast",
    "vsh-archive gaia-crf3 --show",
    "vsh-sim link --output stars.csv",
    "vsh-link stars.csv --output link --format none",
    "vsh-sim epochs --number 20 --output epochs.fits",
    "vsh-waves epochs.fits --frequencies 1:2:2",
)


def main(dist: Path) -> None:
    """Install the wheel and run all jobs; the first that fails ends it."""
    (wheel,) = sorted(dist.resolve().glob("*.whl"))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        home = Path(folder)
        venv.create(home / "env", with_pip=True)
        programs = home / "env" / ("Scripts" if os.name == "nt" else "bin")
        subprocess.run([programs / "python", "-m", "pip", "install", "--quiet", str(wheel)], check=True)
        work = home / "work"
        (work / "sim").mkdir(parents=True)
        (work / "sim" / "__init__.py").touch()
        for name in ("fit.py", "study.py"):
            (work / name).write_text("raise SystemExit('this is a user's own')\n")
        shutil.copy(Path(__file__).parents[1] / "docs" / "commands" / "survey.toml", work)
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        for job in JOBS:
            program, *words = job.split()
            done = subprocess.run(
                [programs / program, *words], cwd=work, env=environment, capture_output=True, text=True, check=False,
                encoding="utf-8",
            )  # fmt: skip
            print(f"{done.returncode}  {job}", flush=True)
            if done.returncode:
                sys.exit(done.stdout + done.stderr)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
