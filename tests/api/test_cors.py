"""Web pages of other origins: which may use the service, keys or not."""

from collections.abc import Iterator

import httpx
import pytest
from pydantic import ValidationError

from app.settings import Settings
from tests.served import serving

KEY = "first-key-0123456789"
ORIGIN = "https://lab.example.org"


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service without models that asks for a key and allows one origin."""
    store = tmp_path_factory.mktemp("empty")
    settings = Settings(model_store=store, api_keys=KEY, cors_origins=(ORIGIN,))
    with serving(settings) as client:
        yield client


def preflight(client: httpx.Client, origin: str = ORIGIN, **asked: str) -> httpx.Response:
    asked = {"method": "POST", "headers": "authorization,content-type,x-request-id"} | asked
    headers = {f"Access-Control-Request-{name}": text for name, text in asked.items()}
    return client.options("/plan", headers={"Origin": origin, **headers})


def test_a_preflight_needs_no_key(guarded: httpx.Client) -> None:
    answer = preflight(guarded)
    assert answer.status_code == 200
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    assert answer.headers["access-control-allow-methods"] == "GET, POST"
    allowed = answer.headers["access-control-allow-headers"].lower()
    assert {"authorization", "content-type", "x-request-id"} <= set(allowed.split(", "))
    assert "access-control-allow-credentials" not in answer.headers


@pytest.mark.parametrize(
    "asked", [{"origin": "https://evil.example.org"}, {"method": "DELETE"}, {"headers": "x-other"}]
)
def test_a_preflight_for_anything_else_is_refused(
    guarded: httpx.Client, asked: dict[str, str]
) -> None:
    assert preflight(guarded, **asked).status_code == 400


@pytest.mark.parametrize("headers", [{}, {"Authorization": f"Bearer {KEY}"}])
def test_answers_and_refusals_can_be_read_by_the_origin(
    guarded: httpx.Client, headers: dict[str, str]
) -> None:
    answer = guarded.get("/info", headers={"Origin": ORIGIN, **headers})
    assert answer.status_code == (200 if headers else 401)
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    exposed = answer.headers["access-control-expose-headers"]
    assert set(exposed.split(", ")) == {"X-Request-ID", "Server-Timing", "Retry-After"}


def test_another_origin_gets_no_permission(guarded: httpx.Client) -> None:
    answer = guarded.get("/livez", headers={"Origin": "https://evil.example.org"})
    assert "access-control-allow-origin" not in answer.headers


def test_without_origins_there_is_no_cors(client: httpx.Client) -> None:
    assert preflight(client).status_code == 405
    answer = client.get("/livez", headers={"Origin": ORIGIN})
    assert not any(name.startswith("access-control") for name in answer.headers)


@pytest.mark.parametrize("origin", ["*", "lab.example.org", "https://lab.example.org/", "https://"])
def test_what_is_no_origin_is_refused_at_start(origin: str) -> None:
    with pytest.raises(ValidationError, match="cors_origins"):
        Settings(cors_origins=(origin,))
