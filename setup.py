"""The one step that setup.cfg cannot say: the script of the interactive page, from npm's lock in requirements/page."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import Command, setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

ROOT = Path(__file__).parent
SOURCE = ROOT / "requirements" / "page"
#: What is made; not in the repository, in every wheel and sdist that was built where there is npm.
BUNDLE, LICENCES = (ROOT / "vsh" / "page" / name for name in ("d3.min.js", "d3.LICENSES.txt"))


class BuildPage(Command):
    """Make the bundle of d3 with its licences, if npm is there; without it the package writes static pages."""

    description = "make the script of the interactive page (needs npm)"
    user_options = [("required", None, "fail where it cannot be made")]  # noqa: RUF012  # as setuptools has it
    boolean_options = ["required"]  # noqa: RUF012

    def initialize_options(self):
        self.required = False

    def finalize_options(self):
        pass

    def run(self):
        newest = max(path.stat().st_mtime for path in SOURCE.iterdir())
        if BUNDLE.exists() and LICENCES.exists() and BUNDLE.stat().st_mtime >= newest:
            return
        try:
            make_bundle()
        except (OSError, subprocess.SubprocessError) as error:
            told = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip()
            said = f"the script of the interactive page was not made ({error}): pages will be static\n{told[-500:]}".strip()
            if self.required:
                sys.exit(said)
            print(said, file=sys.stderr)


def make_bundle():
    """What d3.js names of d3, in one file, and the licences of all that is in it."""
    npm = shutil.which("npm")
    if npm is None:
        raise OSError("there is no npm")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name in ("package.json", "package-lock.json", "d3.js"):
            shutil.copy(SOURCE / name, work)
        quiet = {"cwd": work, "check": True, "capture_output": True, "timeout": 120}
        # Where no registry can be reached an installation should not wait for it.
        few = [
            "--fetch-retries=1",
            "--fetch-timeout=15000",
            "--fetch-retry-mintimeout=1000",
            "--fetch-retry-maxtimeout=5000",
        ]
        subprocess.run([npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", *few], **quiet)
        subprocess.run([npm, "run", "build", "--", "--metafile=meta.json"], **quiet)
        inside = json.loads((work / "meta.json").read_text())["inputs"]
        packages = sorted({name.split("/")[1] for name in inside if name.startswith("node_modules/")})
        texts = [f"{name}\n\n{(work / 'node_modules' / name / 'LICENSE').read_text().strip()}" for name in packages]
        LICENCES.write_text("\n\n---\n\n".join(texts) + "\n", encoding="utf-8")
        shutil.copy(work / "d3.min.js", BUNDLE)


class WithPage(build_py):
    """The build, with the bundle."""

    def run(self):
        self.run_command("build_page")
        super().run()


class SourceWithPage(sdist):
    """The source distribution, with the bundle: an install from it needs no npm."""

    def run(self):
        self.run_command("build_page")
        super().run()


setup(cmdclass={"build_page": BuildPage, "build_py": WithPage, "sdist": SourceWithPage})
