"""Paths: below the root path or not, whole URLs, slashes at the end; keys go by the same path."""

import socket
from collections.abc import Iterator

import httpx
import pytest

from app.launch import START_SECONDS
from app.settings import Settings
from tests.served import serving

KEY = "a-key-that-is-long-enough"
ROOT = "/lab/planner"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service without models that has a root path and keys."""
    store = tmp_path_factory.mktemp("empty")
    settings = Settings.model_validate(
        {"model_store": store, "root_path": f"{ROOT}/", "api_keys": KEY}
    )
    with serving(settings) as client:
        yield client


def status_of(client: httpx.Client, target: str, key: str = "") -> int:
    """Ask for a target as it is, which no client would send."""
    lines = [f"GET {target} HTTP/1.1", "Host: x", "Connection: close"]
    lines += [f"Authorization: Bearer {key}"] if key else []
    address = (client.base_url.host, client.base_url.port)
    with socket.create_connection(address, timeout=START_SECONDS) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(connection.recv(65536).split(b" ")[1])


@pytest.mark.parametrize("before", ["", ROOT, "http://x", f"http://x{ROOT}", f"HTTPS://x:1{ROOT}"])
def test_a_path_is_understood_however_it_is_written(client: httpx.Client, before: str) -> None:
    assert status_of(client, f"{before}/livez") == 200
    assert status_of(client, f"{before}/livez?a=http://y/plan") == 200
    assert status_of(client, f"{before}/info") == 401
    assert status_of(client, f"{before}/info", KEY) == 200
    assert status_of(client, f"{before}/plan", KEY) == 405
    assert status_of(client, f"{before}/static-offline-docs/favicon.png", KEY) == 200
    assert status_of(client, f"{before}/livezz", KEY) == 404


@pytest.mark.parametrize("target", [ROOT, f"{ROOT}/", "/", "http://x", "http://x?a=1"])
def test_the_root_is_the_documentation(client: httpx.Client, target: str) -> None:
    assert status_of(client, target, KEY) == 200


@pytest.mark.parametrize(
    "target", [f"{ROOT}{ROOT}/livez", "/lab/livez", f"{ROOT}livez", "livez", "ftp://x/livez", "*"]
)
def test_other_paths_are_not_found_and_not_public(client: httpx.Client, target: str) -> None:
    assert status_of(client, target) == 401
    assert status_of(client, target, KEY) == 404


def test_problems_and_metrics_go_by_the_whole_path_and_the_route(client: httpx.Client) -> None:
    headers = {"Authorization": f"Bearer {KEY}"}
    for before in ("", ROOT):
        assert client.get(f"{before}/nope", headers=headers).json()["instance"] == f"{ROOT}/nope"
        for path in ("/docs", "/openapi.json", "/static-offline-docs/favicon.png"):
            assert client.get(f"{before}{path}", headers=headers).is_success
    text = client.get("/metrics", headers=headers).text
    for route in ("/docs", "/openapi.json", "/static-offline-docs"):
        assert f'http_method="GET",method="none",model="none",route="{route}"' in text
    assert ROOT not in text


@pytest.mark.parametrize("path", ["/plan", "/docs", "/livez", "/models", "/static-offline-docs"])
@pytest.mark.parametrize("verb", ["GET", "POST"])
def test_a_slash_at_the_end_is_a_problem_and_leads_nowhere_else(
    client: httpx.Client, verb: str, path: str
) -> None:
    headers = {"Authorization": f"Bearer {KEY}"}
    answer = client.request(verb, f"{path}/", headers=headers)
    assert "location" not in answer.headers
    if path == "/static-offline-docs" and verb == "POST":
        assert answer.status_code == 405
    else:
        assert answer.status_code == 404
        assert answer.json()["detail"] == "there is nothing here; no path ends with a slash"
