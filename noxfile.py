#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""Sessions for those who have no make: `python -m nox --session test`; the Makefile has more."""

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv|virtualenv"
NEWEST = "requirements/newest.txt"
OLDEST = "requirements/oldest.txt"


@nox.session(default=True)
def style(session: nox.Session) -> None:
    """Check form, spelling and types."""
    session.install("--constraint", NEWEST, "--editable", ".[test]")
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    session.run("codespell")
    session.run("mypy")


@nox.session(default=True)
def test(session: nox.Session) -> None:
    """Run the tests that take no more than some ten seconds each."""
    session.install("--constraint", NEWEST, "--editable", ".[test]")
    session.run("pytest", "-m", "not slow", "-n", "auto", "--dist", "worksteal", *session.posargs)


@nox.session(default=False)
def slow(session: nox.Session) -> None:
    """Run the tests that take long."""
    session.install("--constraint", NEWEST, "--editable", ".[test]")
    session.run("pytest", "-m", "slow", "-n", "auto", "--dist", "worksteal", "--durations=50", *session.posargs)


@nox.session(python="3.11", default=False)
def oldest(session: nox.Session) -> None:
    """Run the tests with the lowest versions that setup.cfg allows."""
    session.install("--constraint", OLDEST, "--editable", ".[test]")
    session.run("pytest", "-m", "not slow", "-n", "auto", *session.posargs)


@nox.session(default=False)
def newest(session: nox.Session) -> None:
    """Run the tests with the newest versions there are today."""
    session.install("--upgrade", "--editable", ".[test]")
    session.run("pytest", "-m", "not slow", "-n", "auto", *session.posargs)


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the documentation."""
    session.install("--constraint", NEWEST, "--editable", ".[docs]")
    session.run("sphinx-build", "-W", "--keep-going", "-q", "-b", "html", "docs", "docs/_build/html")


if __name__ == "__main__":
    nox.main()
