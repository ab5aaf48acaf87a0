"""The settings' forms: lists, words, addresses, secrets."""

import pytest
from pydantic import ValidationError

from app.settings import Settings

A, B = "https://a.example", "http://b.example:3000"


def test_lists_are_separated_by_commas() -> None:
    settings = Settings.model_validate({"cors_origins": f"{A}, {B},", "public_paths": ""})
    assert settings.cors_origins == (A, B)
    assert settings.public_paths == ()


@pytest.mark.parametrize("level", ["info", "INFO", "Info"])
def test_words_are_taken_in_any_case(level: str) -> None:
    settings = Settings.model_validate({"log_level": level, "log_format": "JSON"})
    assert settings.log_level == "info"
    assert settings.log_format == "json"


@pytest.mark.parametrize(
    ("written", "path"), [("/planner", "/planner"), ("/a/b-1/", "/a/b-1"), ("/", ""), ("", "")]
)
def test_a_root_path_has_no_slash_at_its_end(written: str, path: str) -> None:
    assert Settings(root_path=written).root_path == path


@pytest.mark.parametrize("path", ["planner", "//", "/a//b", "/a b", "/ä", "/a%20b", "https://a/b"])
def test_what_is_no_path_is_refused(path: str) -> None:
    with pytest.raises(ValidationError, match="root_path"):
        Settings(root_path=path)


def test_proxies_are_addresses_and_networks() -> None:
    written = "127.0.0.1, ::1,10.0.0.0/8,fd00::/8"
    settings = Settings.model_validate({"trusted_proxies": written})
    assert settings.trusted_proxies == ("127.0.0.1", "::1", "10.0.0.0/8", "fd00::/8")
    assert Settings.model_validate({"trusted_proxies": "*"}).trusted_proxies == ("*",)


@pytest.mark.parametrize("proxy", ["localhost", "10.0.0", "10.0.0.1/8", "10.0.0.0/33", "* "])
def test_a_mistyped_proxy_is_refused(proxy: str) -> None:
    with pytest.raises(ValidationError, match="trusted_proxies"):
        Settings(trusted_proxies=("::1", proxy))


def test_keys_are_not_shown() -> None:
    settings = Settings.model_validate({"api_keys": "secret-0123456789abc"})
    assert settings.api_keys is not None
    assert settings.api_keys.get_secret_value() == "secret-0123456789abc"
    assert "secret" not in repr(settings).replace("Secret", "")


@pytest.mark.parametrize(
    "name", ["header_timeout_s", "body_timeout_s", "send_timeout_s", "idle_timeout_s"]
)
def test_time_limits_are_positive(name: str) -> None:
    with pytest.raises(ValidationError, match=name):
        Settings.model_validate({name: 0})
