"""Bodies that are not what they say: each gets its own problem, and never a 500."""

import gzip
import json
import zlib
from collections.abc import Iterable

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.api.test_errors import GOOD, assert_problem

JSON = {"Content-Type": "application/json"}
TEXT = json.dumps(GOOD)
BODY = TEXT.encode()


def type_of(slug: str) -> str:
    return f"urn:breakaway:problem:{slug}"


@pytest.mark.parametrize(
    ("codings", "body"),
    [
        (["gzip"], gzip.compress(BODY, mtime=0)),
        (["GZip"], b"not even compressed"),
        (["deflate"], zlib.compress(BODY)),
        (["br"], BODY),
        (["gzip, identity"], BODY),
        (["identity", "zstd"], BODY),
    ],
)
@pytest.mark.parametrize("path", ["/plan", "/plan_multistep"])
def test_a_compressed_body_is_refused(
    client: httpx.Client, path: str, codings: list[str], body: bytes
) -> None:
    headers = [*JSON.items(), *(("Content-Encoding", coding) for coding in codings)]
    response = client.post(path, content=body, headers=headers)
    problem = assert_problem(response, 415)
    assert problem["type"] == type_of("unsupported-content-encoding")
    assert problem["detail"] == f"Content-Encoding is {', '.join(codings)}; send the body as it is"
    assert response.headers["accept-encoding"] == "identity"


@pytest.mark.parametrize(
    "content_type",
    [
        None,
        "",
        "text/plain",
        "text/json",
        "application/x-www-form-urlencoded",
        "multipart/form-data; boundary=x",
        "application/xml",
        "application/json, text/plain",
        "json",
        "\xff/\xfe",
    ],
)
@pytest.mark.parametrize("path", ["/plan", "/plan_multistep"])
def test_another_content_type_is_refused(
    client: httpx.Client, path: str, content_type: str | None
) -> None:
    headers = httpx.Headers(
        {} if content_type is None else {"Content-Type": content_type}, encoding="latin-1"
    )
    response = client.post(path, content=BODY, headers=headers)
    problem = assert_problem(response, 415)
    assert problem["type"] == type_of("unsupported-content-type")
    given = f"Content-Type is {content_type}" if content_type else "there is no Content-Type"
    advice = "the body must be JSON, sent with Content-Type: application/json"
    assert problem["detail"] == f"{given}; {advice}"
    assert response.headers["accept"] == "application/json"


@pytest.mark.parametrize(
    "headers",
    [
        {"Content-Type": "application/json; charset=utf-8"},
        # JSON is UTF-8, whatever the header says (RFC 8259, Section 11).
        {"Content-Type": "application/json; charset=iso-8859-1"},
        {"Content-Type": "Application/JSON"},
        {"Content-Type": "application/vnd.acme+json"},
        JSON | {"Content-Encoding": "identity"},
        JSON | {"Content-Encoding": ""},
    ],
)
def test_json_by_another_header_is_read(client: httpx.Client, headers: dict[str, str]) -> None:
    assert client.post("/plan", content=BODY, headers=headers).status_code == 200


def test_a_byte_order_mark_does_no_harm(client: httpx.Client) -> None:
    response = client.post("/plan", content=b"\xef\xbb\xbf" + BODY, headers=JSON)
    assert response.status_code == 200


@pytest.mark.parametrize(
    ("body", "slug", "detail"),
    [
        (b"", "not-json", "not JSON: it is empty"),
        (b'{"initial_state": [0, 0], "targ', "not-json", "not JSON: Unterminated string"),
        (b"{]", "not-json", "not JSON: Expecting property name"),
        (TEXT.encode("utf-16"), "not-utf-8", "not UTF-8: byte 0xff at position 0"),
        (gzip.compress(BODY, mtime=0), "not-utf-8", "not UTF-8: byte 0x8b at position 1"),
        (b'{"model": "\xe9"}', "not-utf-8", "not UTF-8: byte 0xe9 at position 11"),
        (b"[" * 50_000, "nested-too-deeply", "arrays and objects are nested too deeply"),
        (b'{"a":' * 12_000, "nested-too-deeply", "arrays and objects are nested too deeply"),
    ],
)
@pytest.mark.parametrize("path", ["/plan", "/plan_multistep"])
def test_a_body_that_cannot_be_read_is_told_why(
    client: httpx.Client, path: str, body: bytes, slug: str, detail: str
) -> None:
    problem = assert_problem(client.post(path, content=body, headers=JSON), 400)
    assert problem["type"] == type_of(slug)
    assert problem["detail"].startswith(detail)


@pytest.mark.parametrize(
    ("field", "pointer", "detail"),
    [
        ('"seed": ' + "9" * 5000, "/seed", "99999999999999999999... (5000 characters) is too "),
        ('"system": {"time_step": 1e999}', "/system/time_step", "1e999 is too large a number"),
        ('"num_candidates": 1' + "0" * 300, "/num_candidates", "at most 4096"),
        ('"deadline_ms": 1' + "0" * 300, "/deadline_ms", "at most 300000"),
        ('"include": ' + "[" * 400 + "]" * 400, "/include/0", ""),
        ('"seed": 1, "seed": 1', "/seed", "the key appears more than once"),
        ('"system": {"a": [{"b": 1, "b": 2}]}', "/system/a/0/b", "the key appears more than once"),
        (r'"\ud800": 1', "", "valid string"),
        (r'"\ud800": 1, "\ud800": 1', r"/\ud800", "the key appears more than once"),
        (r'"model": "\ud800"', "/model", "valid string"),
        (
            '"system": {"static_friction": true}',
            "/system/static_friction",
            "must be a number, or an object",
        ),
        ('"refine": {"repair": "no"}', "/refine/repair", "valid boolean"),
        ('"method": {"name": "cem", "iterations": "3"}', "/method/iterations", "valid integer"),
        ('"system": 3', "/system", "must be an object"),
        ('"include": "states"', "/include", "must be an array"),
    ],
)
def test_a_value_that_means_nothing_is_pointed_at(
    client: httpx.Client, field: str, pointer: str, detail: str
) -> None:
    text = f"{TEXT[:-1]}, {field}}}"
    if field.startswith('"method"'):
        text = text.replace('"method": "uniform", ', "")
    problem = assert_problem(client.post("/plan", content=text.encode(), headers=JSON), 422)
    assert problem["type"] == type_of("invalid-request")
    (error,) = problem["errors"]
    assert error["pointer"] == pointer
    assert detail in error["detail"]


def test_whole_numbers_are_integers_however_they_are_written(client: httpx.Client) -> None:
    fields = '"seed": 7.0, "num_candidates": 2.0, "horizon": 1e1, "refine": {"iterations": 3.0}'
    text = f"{TEXT[:-1]}, {fields}}}"
    answer = client.post("/plan", content=text.encode(), headers=JSON).json()
    assert answer["seed"] == 7
    assert len(answer["controls"]) == 10


def test_a_large_body_has_a_type_declared_or_streamed(client: httpx.Client) -> None:
    sent: Iterable[bytes | Iterable[bytes]] = (b" " * 100_000, (b" " * 1000 for _ in range(100)))
    for content in sent:
        problem = assert_problem(client.post("/plan", content=content, headers=JSON), 413)
        assert problem["type"] == type_of("body-too-large")


def damage(cut: int, inserted: bytes) -> bytes:
    return BODY[:cut] + inserted + BODY[cut:]


@given(
    st.binary(max_size=64)
    | st.builds(damage, st.integers(0, len(BODY)), st.binary(max_size=4))
    | st.builds(damage, st.integers(0, len(BODY)), st.sampled_from([b"9" * 400, b"[" * 2000])),
    st.sampled_from(["/plan", "/plan_multistep"]),
)
@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_no_body_is_a_server_error(client: httpx.Client, body: bytes, path: str) -> None:
    response = client.post(path, content=body, headers=JSON)
    if response.status_code != 200:
        assert response.status_code in (400, 404, 422)
        assert assert_problem(response, response.status_code)["type"] != "about:blank"
