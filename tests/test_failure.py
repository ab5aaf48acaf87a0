import click
import pytest
from click.testing import CliRunner

from app.failure import Failure

REASON = (
    "--port: [blue]8000[/blue] is taken by 'a service whose name needs more than eighty columns'"
)


@click.command()
def fail() -> None:
    raise Failure(REASON)


def test_the_reason_stands_alone_on_standard_error_as_it_is() -> None:
    done = CliRunner().invoke(fail)
    assert (done.exit_code, done.stdout, done.stderr) == (1, "", f"{REASON}\n")


def test_in_a_terminal_it_is_red(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    done = CliRunner().invoke(fail, color=True)
    assert done.stderr == f"\x1b[31m{REASON}\x1b[0m\n"
