"""Settings as options: lists, flags, secrets; what goes before what, and who is at fault."""

from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from app.settings import SHIPPED_MODELS, Settings
from app.settings_options import SettingsCommand

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
    for default in ("127.0.0.1", "8000", "/livez,/readyz", "10.0", "no"):
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


def test_keys_are_not_shown_in_the_help() -> None:
    done, _ = invoke("--help", BREAKAWAY_API_KEYS="secret-0123456789abc")
    assert done.exit_code == 0
    assert "secret-0123456789abc" not in done.stdout
