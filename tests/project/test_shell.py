"""Completion and manual pages, which the build makes of the parsers."""

import argparse
import re
import shutil
import subprocess

import pytest
from conftest import ROOT, run_python

import vsh.__main__ as commands

pytest.importorskip("shtab")
pytest.importorskip("argparse_manpage")


@pytest.fixture(scope="module")
def share(tmp_path_factory):
    """What stands under share/ in a wheel."""
    folder = tmp_path_factory.mktemp("build") / "share"
    code = "import sys, pathlib, setuptools; setuptools.setup = lambda **made: made; sys.argv = ['setup.py']\n"
    code += "space = {'__file__': sys.path[0] + '/setup.py', '__name__': 'setup'}\n"
    code += "exec(compile(open('setup.py', encoding='utf-8').read(), 'setup.py', 'exec'), space)\n"
    code += f"print(*space['make_share'](pathlib.Path({str(folder)!r}), '1.2.3'), sep='\\n')"
    run_python("-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{code}")
    return folder


@pytest.mark.parametrize("command", commands.COMMANDS)
def test_every_command_has_completion_and_a_manual_page(share, command):
    actions = commands.import_command_module(command).make_parser()._actions
    options = {word for action in actions if action.help != argparse.SUPPRESS for word in action.option_strings}
    bash = share / "bash-completion" / "completions" / f"vsh-{command}"
    zsh = (share / "zsh" / "site-functions" / f"_vsh-{command}").read_text(encoding="utf-8")
    page = (share / "man" / "man1" / f"vsh-{command}.1").read_text(encoding="utf-8")
    assert all(option in bash.read_text(encoding="utf-8") for option in options)
    assert all(option in zsh for option in options)
    plain = page.replace("\\-", "-")
    assert all(option in plain for option in options - {"-h", "--help", "--help-all"})
    assert re.search(rf"^vsh-{command} - \w", plain, re.MULTILINE)
    assert "vsh-astrometry 1.2.3" in plain
    if shutil.which("bash"):
        subprocess.run(["bash", "-n", bash], check=True)


def test_completion_completes(share):
    """As bash calls it when the Tab is pressed."""
    if not shutil.which("bash"):
        pytest.skip("there is no bash")
    script = share / "bash-completion" / "completions" / "vsh-fit"
    code = 'source "$0"; COMP_WORDS=(vsh-fit "$@"); COMP_CWORD=$#; _shtab_vsh_fit; echo "${COMPREPLY[@]}"'
    for words, wanted in ((["--me"], "--method"), (["--frame", "g"], "galactic")):
        done = subprocess.run(["bash", "-c", code, script, *words], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == wanted
