"""The settings' forms: environment, lists, secrets."""

import pytest
from pydantic import ValidationError

from app.settings import Settings

A, B = "https://a.example", "http://b.example:3000"


def test_lists_are_separated_by_commas_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BREAKAWAY_CORS_ORIGINS", f"{A}, {B},")
    monkeypatch.setenv("BREAKAWAY_PUBLIC_PATHS", "")
    settings = Settings()
    assert settings.cors_origins == (A, B)
    assert settings.public_paths == ()


def test_keys_are_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BREAKAWAY_API_KEYS", "secret-0123456789abc")
    settings = Settings()
    assert settings.api_keys is not None
    assert settings.api_keys.get_secret_value() == "secret-0123456789abc"
    assert "secret" not in repr(settings).replace("Secret", "")


@pytest.mark.parametrize(
    "name", ["header_timeout_s", "body_timeout_s", "send_timeout_s", "idle_timeout_s"]
)
def test_time_limits_are_positive(name: str) -> None:
    with pytest.raises(ValidationError, match=name):
        Settings.model_validate({name: 0})
