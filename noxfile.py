#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.10.14"]
# ///
"""The commands of the Makefile, each in an environment of its own: `nox -s tests-3.13`, `nox -l`
lists all.
"""

from pathlib import Path

import nox

nox.needs_version = ">=2025.10.14"
nox.options.default_venv_backend = "uv|virtualenv"

PLUGINS = sorted(str(path.parent) for path in Path("plugins").glob("*/pyproject.toml"))
CONSTRAINTS = ("--constraint", "constraints.txt")


@nox.session(python=["3.11", "3.12", "3.13"], default=False)
def tests(session: nox.Session) -> None:
    """Run the quick tests, or what is named: `nox -s tests-3.13 -- tests/core/scene`."""
    session.install(*CONSTRAINTS, ".[test]", *PLUGINS)
    session.run("pytest", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Check code, formatting, and what the Scientific Python guide asks of a repository."""
    session.install(*CONSTRAINTS, "ruff", "sp-repo-review[cli]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("repo-review", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types of the core and the plugins."""
    session.install(*CONSTRAINTS, "--editable", ".[test,peers,lint]", *PLUGINS)
    session.run("mypy")


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the site of the documentation into build/site."""
    session.install(*CONSTRAINTS, ".[docs]", *PLUGINS)
    session.run("sphinx-build", "-W", "--keep-going", "--quiet", "-b", "html", "docs", "build/site")


if __name__ == "__main__":
    nox.main()
