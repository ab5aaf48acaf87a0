"""The command as a whole: its help, its version, its speed."""

import subprocess
import sys
from importlib.metadata import version

import pytest

from app.cli import breakaway
from tests.cli.command import invoke


def test_help_lists_every_command_with_its_purpose_in_full() -> None:
    done = invoke("--help")
    assert done.exit_code == 0
    for name, command in breakaway.commands.items():
        assert f"  {name}" in done.stdout
        assert command.get_short_help_str(limit=70) in done.stdout
    assert "..." not in done.stdout.replace("[ARGS]...", "")


def test_without_a_command_it_shows_its_help() -> None:
    done = invoke()
    assert done.exit_code == 2
    assert done.stderr == invoke("--help").stdout


def test_it_says_its_version() -> None:
    assert invoke("--version").stdout == f"breakaway {version('breakaway')}\n"


def test_an_unknown_command_is_named() -> None:
    done = invoke("frobnicate")
    assert done.exit_code == 2
    assert "frobnicate" in done.stderr


@pytest.mark.parametrize("command", ["serve", "plan", "control", "evaluate", "models", "bench"])
def test_every_command_has_help(command: str) -> None:
    done = invoke(command, "--help")
    assert done.exit_code == 0
    assert f"Usage: breakaway {command}" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "absent"),
    [
        (["--help"], {"torch", "numba", "numpy", "pydantic"}),
        (["plan", "--help"], {"torch", "numba", "numpy", "pydantic"}),
        (["control", "--help"], {"torch", "numba", "numpy", "pydantic"}),
        (["models", "--help"], {"torch", "numba", "numpy", "pydantic"}),
        (["serve", "--help"], {"torch", "numba", "numpy"}),
        (["models"], {"torch", "numba"}),
    ],
)
def test_what_is_quick_loads_nothing_large(arguments: list[str], absent: set[str]) -> None:
    program = (
        "import sys; from app.cli import breakaway; "
        f"breakaway({arguments}, prog_name='breakaway', standalone_mode=False); "
        "print(*sys.modules, file=sys.stderr)"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not absent & set(done.stderr.split())
