"""The steps that setup.cfg cannot say: the script of the interactive page, completion for shells, manual pages."""

import gzip
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from setuptools import Command, setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

ROOT = Path(__file__).parent
SOURCE = ROOT / "requirements" / "page"
#: Where completion and manual pages are made.
SHARE = ROOT / "build" / "share"
#: The script of the page and the licences of what is in it: files of the repository, which `make page` renews.
BUNDLE, LICENCES = (ROOT / "vsh" / "figures" / "page" / name for name in ("d3.min.js", "d3.LICENSES.txt"))


class BuildPage(Command):
    """Make the bundle of d3 with its licences anew, by npm from its lock: files of the repository."""

    description = "make the script of the interactive page (needs npm)"
    user_options = []  # noqa: RUF012  # as setuptools has it

    def initialize_options(self):
        pass

    def finalize_options(self):
        pass

    def run(self):
        try:
            make_bundle(BUNDLE, LICENCES)
        except (OSError, subprocess.SubprocessError) as error:
            output = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip()
            sys.exit(f"the script of the page was not made ({error})\n{output[-500:]}".strip())


def make_bundle(bundle, licences):
    """What d3.js names of d3, in one file, and the licences of all that is in it."""
    npm = shutil.which("npm")
    if npm is None:
        raise OSError("there is no npm")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for name in ("package.json", "package-lock.json", "d3.js"):
            shutil.copy(SOURCE / name, work)
        quiet = {"cwd": work, "check": True, "capture_output": True, "timeout": 120}
        subprocess.run([npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"], **quiet)
        subprocess.run([npm, "run", "build", "--", "--metafile=meta.json"], **quiet)
        inside = json.loads((work / "meta.json").read_text())["inputs"]
        packages = sorted({name.split("/")[1] for name in inside if name.startswith("node_modules/")})
        texts = [f"{name}\n\n{(work / 'node_modules' / name / 'LICENSE').read_text().strip()}" for name in packages]
        licences.write_text("\n\n---\n\n".join(texts) + "\n", encoding="utf-8")
        shutil.copy(work / "d3.min.js", bundle)


class BuildShell(Command):
    """Completion for bash and zsh (shtab) and manual pages (argparse-manpage) of every command, from its parser."""

    description = "make completion for shells and manual pages"
    user_options = []  # noqa: RUF012

    def initialize_options(self):
        pass

    def finalize_options(self):
        pass

    def run(self):
        made = {}
        for path in make_share(SHARE, self.distribution.get_version()):
            made.setdefault(f"share/{path.parent.relative_to(SHARE)}", []).append(path.relative_to(ROOT).as_posix())
        self.distribution.data_files = [*(self.distribution.data_files or []), *made.items()]


def make_share(folder, version):
    """Completion and manual pages of every command in a folder; returns their paths."""
    sys.path.insert(0, str(ROOT))
    import shtab
    from argparse_manpage.manpage import Manpage

    from vsh.__main__ import COMMANDS, import_command_module
    from vsh.__main__ import describe_command as purpose

    about = {
        "project_name": "vsh-astrometry",
        "version": version,
        "manual_title": "vsh-astrometry",
        "manual_section": 1,
    }
    texts = {}
    for name in COMMANDS:
        words = import_command_module(name)
        parser = words.make_parser()
        texts[f"man/man1/vsh-{name}.1"] = str(Manpage(words.make_parser(), about | {"description": purpose(name)}))
        for action in parser._actions:
            if action.metavar in ("FILE", "MAP") or (not action.option_strings and not action.choices):
                action.complete = shtab.FILE
            elif action.metavar == "DIR":
                action.complete = shtab.DIRECTORY
        texts[f"bash-completion/completions/vsh-{name}"] = shtab.complete(parser, "bash")
        texts[f"zsh/site-functions/_vsh-{name}"] = shtab.complete(parser, "zsh")
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


class WithShell(build_py):
    """The build, with what shells want."""

    def run(self):
        self.run_command("build_shell")
        super().run()


class SameSource(sdist):
    """The source distribution, the same bytes each time."""

    def make_archive(self, *arguments, **options):
        """The same bytes for the same files, where SOURCE_DATE_EPOCH says when they are from."""
        path = super().make_archive(*arguments, **options)
        if "SOURCE_DATE_EPOCH" in os.environ and path.endswith(".tar.gz"):
            pack_again(Path(path), int(os.environ["SOURCE_DATE_EPOCH"]))
        return path


def pack_again(path, when):
    """A tar without owners and with one time for all, its members in order."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(path) as archive:
            archive.extractall(folder, filter="data")
            names = sorted(archive.getnames())
        with (
            open(path, "wb") as raw,
            gzip.GzipFile("", "wb", 9, raw, mtime=when) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for name in names:
                entry = archive.gettarinfo(Path(folder) / name, name)
                entry.uid = entry.gid = 0
                entry.uname = entry.gname = ""
                entry.mtime, entry.mode = when, 0o755 if entry.isdir() or entry.mode & 0o100 else 0o644
                if entry.isreg():
                    with open(Path(folder) / name, "rb") as file:
                        archive.addfile(entry, file)
                else:
                    archive.addfile(entry)


def addresses():
    """Where the project lives: one variable, which the workflows set; nothing is made up where nobody says it."""
    repository = os.environ.get("GITHUB_REPOSITORY")
    if not repository:
        return {}
    source = f"https://github.com/{repository}"
    owner, name = repository.split("/")
    return {
        "Source": source, "Issues": f"{source}/issues", "Changelog": f"{source}/blob/main/CHANGELOG.md",
        "Documentation": f"https://{owner}.github.io/{name}/",
    }  # fmt: skip


setup(
    cmdclass={"build_page": BuildPage, "build_shell": BuildShell, "build_py": WithShell, "sdist": SameSource},
    # Made by the build; without one here, there would be nothing of which it asks.
    data_files=[],
    project_urls=addresses(),
)
