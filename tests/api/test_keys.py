"""API keys: where they come from, what they open, and what stays open without them."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.api.keys import KeysRejected, read_keys
from app.settings import Settings
from tests.api.test_errors import assert_problem
from tests.metrics import value
from tests.served import serving

KEY, FILED_KEY = "first-key-0123456789", "another-key-in-a-file"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client without a key of a service without models that asks for one of three."""
    folder = tmp_path_factory.mktemp("keys")
    (folder / "keys").write_text(f"# for the laboratory\n\n  {FILED_KEY}  \n")
    settings = Settings(
        model_store=folder,
        api_keys=f"{KEY},second-key-0123456789",
        api_keys_file=folder / "keys",
        public_paths=("/livez", "/readyz", "/docs", "/static-offline-docs/*"),
    )
    with serving(settings) as client:
        yield client


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


@pytest.mark.parametrize("path", ["/plan", "/metrics", "/openapi.json", "/info", "/nope", "/"])
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Authorization": "Bearer"},
        {"Authorization": KEY},
        {"Authorization": f"Basic {KEY}"},
        bearer("wrong-key-0123456789"),
        bearer(KEY + "x"),
        bearer(KEY[:-1]),
        bearer("é" * 16),
    ],
)
def test_private_paths_need_a_key(client: httpx.Client, path: str, headers: dict[str, str]) -> None:
    raw = {name.encode(): text.encode() for name, text in headers.items()}
    for verb in ("GET", "POST", "HEAD", "OPTIONS"):
        answer = client.request(verb, path, headers=raw)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert answer.headers["x-request-id"]
        if verb != "HEAD":
            problem = assert_problem(answer, 401)
            assert KEY not in str(problem)


@pytest.mark.parametrize("key", [KEY, "second-key-0123456789", FILED_KEY])
def test_each_key_opens(client: httpx.Client, key: str) -> None:
    assert client.get("/info", headers=bearer(key)).status_code == 200
    assert client.get("/nope", headers=bearer(key)).status_code == 404
    lower = {"authorization": f"bearer {key}"}
    assert client.get("/info", headers=lower).status_code == 200


def test_public_paths_need_none(client: httpx.Client) -> None:
    assert client.get("/livez").status_code == 200
    assert client.get("/readyz").status_code in (200, 503)
    assert client.get("/docs").status_code == 200
    assert client.get("/static-offline-docs/swagger-ui.css").status_code == 200
    for path in ("/livez/", "/livez/../info", "/static-offline-docs", "/%2e/livez", "//livez"):
        assert client.get(path).status_code == 401


def test_refusals_are_counted(client: httpx.Client) -> None:
    def refused() -> float:
        text = client.get("/metrics", headers=bearer(KEY)).text
        return value(text, "breakaway_requests_total", status="401", http_method="PUT")

    before = refused()
    client.put("/plan")
    assert refused() == before + 1


def test_the_documentation_says_where_keys_are_needed(client: httpx.Client) -> None:
    document = client.get("/openapi.json", headers=bearer(KEY)).json()
    (scheme,) = document["components"]["securitySchemes"].items()
    assert scheme[1] == {"type": "http", "scheme": "bearer"}
    for path, operations in document["paths"].items():
        for operation in operations.values():
            is_private = path not in ("/livez", "/readyz")
            assert ("401" in operation["responses"]) == is_private
            assert operation.get("security", []) == ([{scheme[0]: []}] if is_private else [])


def test_keys_are_kept_as_digests_and_never_shown(tmp_path: Path) -> None:
    (tmp_path / "keys").write_text(FILED_KEY)
    settings = Settings(api_keys=KEY, api_keys_file=tmp_path / "keys")
    digests = read_keys(settings)
    assert [len(digest) for digest in digests] == [32, 32]
    assert KEY not in repr(settings)


def test_no_keys_are_none() -> None:
    assert read_keys(Settings()) == []


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        ("", "api_keys holds no key"),
        (" , ", "api_keys holds no key"),
        ("short", "key 1 of api_keys must be at least 16"),
        (f"{KEY},short", "key 2 of api_keys must be at least 16"),
        ("a key with blanks in it", "without blanks"),
        ("ключ-из-кириллицы", "ASCII"),
    ],
)
def test_weak_keys_are_refused_and_not_repeated(keys: str, complaint: str) -> None:
    with pytest.raises(KeysRejected, match=complaint) as refused:
        read_keys(Settings(api_keys=keys))
    assert not keys.strip(" ,") or keys not in str(refused.value)


@pytest.mark.parametrize("content", [None, b"", b"# only a comment\n\n", b"short\n", b"\xff\xfe"])
def test_a_file_without_good_keys_is_refused(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "keys"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(KeysRejected, match=str(file)):
        read_keys(Settings(api_keys_file=file))
