"""Settings as options: lists, flags, secrets; what goes before what, and who is at fault."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from app.failure import Failure
from app.settings import PLAN_SETTINGS, SHIPPED_MODELS, Settings
from app.settings_options import SettingsCommand, read_settings
from tests.test_environment import INJECTED

A, B = "https://a.example", "http://b.example:3000"


def invoke(*options: str, **environment: str) -> tuple[Result, list[Settings]]:
    """Run a command that keeps the settings it was called with."""
    kept = []

    @click.command(cls=SettingsCommand)
    def keep(settings: Settings) -> None:
        kept.append(settings)

    return CliRunner().invoke(keep, options, env=environment), kept


def read(*options: str, **environment: str) -> Settings:
    done, kept = invoke(*options, **environment)
    assert done.exit_code == 0, done.stderr
    (settings,) = kept
    return settings


def test_without_options_everything_is_as_the_settings_have_it() -> None:
    assert read() == Settings()


def test_every_setting_is_an_option_with_its_description_and_default() -> None:
    done, _ = invoke("--help")
    text = " ".join(done.stdout.split())
    for name, field in Settings.model_fields.items():
        assert f"--{name.replace('_', '-')} " in text
        assert field.description is not None
        assert field.description in text
    for default in ("127.0.0.1", "8000", "/livez,/readyz,/,/playground/*", "10.0", "no"):
        assert f"[default: {default}]" in text
    assert str(SHIPPED_MODELS) in text


def test_values_are_read_as_the_settings_read_them(tmp_path: Path) -> None:
    settings = read("--port", "9000", "--header-timeout-s", "2.5", "--model-store", str(tmp_path))
    assert settings.port == 9000
    assert settings.header_timeout_s == 2.5
    assert settings.model_store == tmp_path


@pytest.mark.parametrize(
    "options", [["--cors-origins", f"{A},{B}"], ["--cors-origins", A, "--cors-origins", B]]
)
def test_lists_are_separated_by_commas_or_repeated(options: list[str]) -> None:
    assert read(*options).cors_origins == (A, B)


def test_a_list_may_be_empty() -> None:
    assert read("--public-paths", "").public_paths == ()


def test_an_option_goes_before_its_variable() -> None:
    assert read("--port", "9000", BREAKAWAY_PORT="9001").port == 9000
    assert read(BREAKAWAY_PORT="9001").port == 9001


def test_what_is_on_or_off_is_a_flag() -> None:
    assert read("--admin").admin
    assert not read("--no-admin", BREAKAWAY_ADMIN="true").admin
    assert read(BREAKAWAY_ADMIN="true").admin


def test_every_bad_value_is_named_by_where_it_came_from() -> None:
    done, kept = invoke("--port", "100000", "--cors-origins", f"{A},b", BREAKAWAY_MAX_PENDING="0")
    assert done.exit_code == 1
    assert kept == []
    pattern = Settings.model_json_schema()["properties"]["cors_origins"]["items"]["pattern"]
    assert done.stderr.splitlines() == [
        "--port: Input should be less than or equal to 65535",
        f"--cors-origins: String should match pattern '{pattern}'",
        "BREAKAWAY_MAX_PENDING: Input should be greater than 0",
    ]


def test_an_injected_port_is_none_of_ours() -> None:
    assert read(**INJECTED).port == 8000
    assert read("--port", "9001", **INJECTED).port == 9001
    assert read(**INJECTED | {"BREAKAWAY_PORT": "9000"}).port == 9000


def test_a_mistyped_variable_is_said_with_what_may_be_meant() -> None:
    mistyped = {"BREAKAWAY_API_KEYES": "x", "BREAKAWAY_API_KEY": "x", "BREAKAWAY_FOO": "x"}
    done, kept = invoke(**mistyped, BREAKAWAY_MAX_PENDING="0")
    assert done.exit_code == 1
    assert kept == []
    assert sorted(done.stderr.splitlines()) == [
        "BREAKAWAY_API_KEY: there is no such setting; did you mean BREAKAWAY_API_KEYS?",
        "BREAKAWAY_API_KEYES: there is no such setting; did you mean BREAKAWAY_API_KEYS?",
        "BREAKAWAY_FOO: there is no such setting",
        "BREAKAWAY_MAX_PENDING: Input should be greater than 0",
    ]


def test_a_command_reads_only_what_it_needs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in (INJECTED | {"BREAKAWAY_MAX_PENDING": "none"}).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("BREAKAWAY_LOG_LEVEL", "loud")
    monkeypatch.setenv("BREAKAWAY_API_KEY", "a client's")
    monkeypatch.setenv("BREAKAWAY_MODEL_STORE", str(tmp_path))
    monkeypatch.setenv("BREAKAWAY_MAX_CANDIDATES", "8")
    assert read_settings(["model_store"]) == Settings(model_store=tmp_path)
    assert read_settings(PLAN_SETTINGS) == Settings(model_store=tmp_path, max_candidates=8)
    monkeypatch.setenv("BREAKAWAY_MAX_CANDIDATES", "0")
    with pytest.raises(
        Failure, match=r"^BREAKAWAY_MAX_CANDIDATES: Input should be greater than 0$"
    ):
        read_settings(PLAN_SETTINGS)
    monkeypatch.setenv("BREAKAWAY_MODLE_STORE", "x")
    with pytest.raises(Failure, match=r"^BREAKAWAY_MODLE_STORE: .*BREAKAWAY_MODEL_STORE"):
        read_settings(["model_store"])


def test_keys_are_not_shown_in_the_help() -> None:
    done, _ = invoke("--help", BREAKAWAY_API_KEYS="secret-0123456789abc")
    assert done.exit_code == 0
    assert "secret-0123456789abc" not in done.stdout
