#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.10.14"]
# ///
"""`nox` tries the project on every Python that is installed: each session has an environment of its own.

`./run test` does the same work on one Python, and brings system libraries and a browser; where those are missing the
tests of the page are left out here.
"""

from __future__ import annotations

import nox

nox.needs_version = ">=2025.10.14"
nox.options.default_venv_backend = "uv|virtualenv"
PYTHONS = nox.project.python_versions(nox.project.load_toml("pyproject.toml"))


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """The tests that are quick; `nox -s tests-3.13 -- tests/test_frames.py` runs those that are named."""
    session.install("--editable", ".[test]")
    session.run(
        "pytest",
        *(session.posargs or ["-m", "not slow and not thorough", "-n", "auto", "--dist", "loadfile"]),
    )


@nox.session(default=False)
def lint(session: nox.Session) -> None:
    """Ruff, its formatter and mypy."""
    session.install("--editable", ".[test]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """The pages of docs/; a warning is an error."""
    session.install("--editable", ".[scans,page,docs]")
    session.run("sphinx-build", "-W", "docs", "build/docs")


@nox.session(default=False)
def artefacts(session: nox.Session) -> None:
    """Wheel and sdist, built and tried as a user would."""
    session.run(".ci/artefacts", external=True)


if __name__ == "__main__":
    nox.main()
