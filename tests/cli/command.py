"""The `breakaway` command, as a user runs it in a process of its own, and within the test's."""

import os
import subprocess
import sys
from pathlib import Path

from click.testing import CliRunner, Result

from app.cli import breakaway
from app.launch import START_SECONDS


def run(*arguments: str, cwd: Path, store: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command in another directory, with a model store of its own if `store` names one."""
    return _run("-m", "app", *arguments, cwd=cwd, store=store)


def run_python(script: str, cwd: Path, store: Path) -> subprocess.CompletedProcess[str]:
    """Run a script in another directory, with a model store of its own."""
    return _run("-c", script, cwd=cwd, store=store)


def _run(*arguments: str, cwd: Path, store: Path | None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | ({"BREAKAWAY_MODEL_STORE": str(store)} if store else {})
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=START_SECONDS,
    )


def invoke(*arguments: str, standard_input: str | None = None, **environment: str) -> Result:
    """Run the command within this process; what it raises beside its own end is a failed test."""
    done = CliRunner().invoke(breakaway, arguments, input=standard_input, env=environment)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done
