"""How answers go out: compressed or not, slowly taken, left lying, and counted until they are sent.

All over real sockets.
"""

import gzip
import json
import socket
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic, sleep
from typing import Any

import httpx
import numpy as np
import pytest

from app.api.sending import accepts_gzip
from app.client import PlannerClient, PlanRequest
from app.launch import START_SECONDS
from app.planning.stop import Stop
from app.serving.bodies import make_body
from app.serving.refusals import DeadlineExceeded
from app.settings import Settings
from tests.metrics import value
from tests.served import serving, wait_until, wait_until_ready

SEND_TIMEOUT_S = 1.0
SMALL: dict[str, Any] = {
    "initial_state": [0.0, 0.0],
    "target_state": [0.2, 0.0],
    "method": "uniform",
    "seed": 1,
}
LARGE = SMALL | {"num_candidates": 600, "include": ["states", "candidates"]}
"""Some 2 MB."""
RECEIVED_AT_ONCE = 1 << 15


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service with a short send timeout and room for one large answer."""
    settings = Settings(
        model_store=tmp_path_factory.mktemp("empty"),
        send_timeout_s=SEND_TIMEOUT_S,
        max_pending_answer_bytes=4_000_000,
    )
    with serving(settings) as client:
        wait_until_ready(client)
        yield client


@contextmanager
def asked(client: httpx.Client, body: dict[str, Any]) -> Iterator[socket.socket]:
    """Ask for a plan on a connection with a small buffer, and read nothing yet."""
    content = json.dumps(body).encode()
    head = (
        "POST /plan HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(content)}\r\n\r\n"
    )
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVED_AT_ONCE)
        connection.settimeout(START_SECONDS)
        connection.connect((client.base_url.host, client.base_url.port))
        connection.sendall(head.encode() + content)
        yield connection


def unsent_bytes(client: httpx.Client) -> float:
    return value(client.get("/metrics").text, "breakaway_answer_bytes")


def raw(client: httpx.Client, body: dict[str, Any], accept_encoding: str) -> tuple[Any, bytes]:
    """Return an answer's headers and its body as it came."""
    headers = {"Accept-Encoding": accept_encoding}
    with client.stream("POST", "/plan", json=body, headers=headers) as response:
        assert response.status_code == 200
        return response.headers, b"".join(response.iter_raw())


def without_timing(text: bytes) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(text)
    del answer["timing_ms"]
    return answer


def test_a_large_answer_is_the_same_with_and_without_gzip(client: httpx.Client) -> None:
    plain_headers, plain = raw(client, LARGE, "identity")
    headers, packed = raw(client, LARGE, "br, gzip;q=0.5")

    assert "content-encoding" not in plain_headers
    assert headers["content-encoding"] == "gzip"
    assert len(packed) < 0.6 * len(plain)
    assert without_timing(gzip.decompress(packed)) == without_timing(plain)
    for found, text in ((plain_headers, plain), (headers, packed)):
        assert found["vary"] == "Accept-Encoding"
        assert found["content-type"] == "application/json"
        assert int(found["content-length"]) == len(text)


def test_a_small_answer_is_sent_as_it_is(client: httpx.Client) -> None:
    headers, text = raw(client, SMALL, "gzip")
    assert "content-encoding" not in headers
    assert headers["vary"] == "Accept-Encoding"
    assert len(json.loads(text)["controls"]) == 64


def test_the_client_reads_a_large_answer_as_typed_as_a_small_one(client: httpx.Client) -> None:
    with PlannerClient(str(client.base_url)) as planner:
        answer = planner.plan(PlanRequest.model_validate(LARGE))
    assert answer.candidates is not None
    assert answer.candidates.states is not None
    assert len(answer.candidates.controls) == len(answer.candidates.states) == 600
    assert type(answer.candidates.controls[599][63]) is float
    assert type(answer.candidates.states[599][64]) is tuple
    assert answer.controls in answer.candidates.controls


@pytest.mark.parametrize(
    ("header", "accepted"),
    [
        ("", False),
        ("gzip", True),
        ("GZip", True),
        ("x-gzip", True),
        ("deflate, gzip;q=0.1", True),
        ("*", True),
        ("identity", False),
        ("br", False),
        ("gzip;q=0", False),
        ("gzip ; q=0.000", False),
        ("*;q=0.5, gzip;q=0", False),
        ("gzip, *;q=0", True),
        ("gzip;q=0.5, identity", False),
        ("gzip;q=0.5, identity;q=0.4", True),
        ("identity;q=0, gzip;q=0.1", True),
        ("gzip;q=much", False),
        ("gzipped", False),
        (", ,gzip;level=1;q=0.7", True),
    ],
)
def test_whether_a_client_accepts_gzip(header: str, accepted: bool) -> None:
    assert accepts_gzip(header) is accepted


def test_a_client_that_never_reads_is_dropped_and_its_answer_counted_until_then(
    client: httpx.Client,
) -> None:
    size = len(raw(client, LARGE, "identity")[1])
    wait_until(lambda: unsent_bytes(client) == 0)
    with asked(client, LARGE):
        wait_until(lambda: abs(unsent_bytes(client) - size) < 10)  # a time has fewer digits
        refused = client.post("/plan", json=LARGE)
        assert refused.status_code == 429
        assert refused.headers["content-type"] == "application/problem+json"
        assert refused.headers["retry-after"] == "1"
        assert "bytes of answers would be pending" in refused.json()["detail"]
        assert client.post("/plan", json=SMALL).status_code == 200

        wait_until(lambda: unsent_bytes(client) == 0)
    assert client.post("/plan", json=LARGE).status_code == 200


def test_the_answer_of_a_client_that_hangs_up_is_counted_no_more(client: httpx.Client) -> None:
    with asked(client, LARGE) as connection:
        assert connection.recv(10)
        assert unsent_bytes(client) > 0
    wait_until(lambda: unsent_bytes(client) == 0)


def test_a_refused_request_leaves_nothing_counted(client: httpx.Client) -> None:
    assert client.post("/plan", json=LARGE | {"deadline_ms": 1}).status_code == 429
    assert unsent_bytes(client) == 0


def test_a_slow_but_steady_reader_gets_everything(client: httpx.Client) -> None:
    expected = without_timing(raw(client, LARGE, "identity")[1])
    began = monotonic()
    with asked(client, LARGE) as connection:
        text = b""
        while not text.endswith(b"}}") or text.count(b"{") != text.count(b"}"):
            part = connection.recv(RECEIVED_AT_ONCE)
            assert part
            text += part
            sleep(SEND_TIMEOUT_S / 40)
    assert monotonic() - began > SEND_TIMEOUT_S
    assert without_timing(text.partition(b"\r\n\r\n")[2]) == expected


def test_others_are_answered_while_a_large_answer_is_made_and_sent(client: httpx.Client) -> None:
    done = threading.Event()
    sizes: deque[int] = deque()

    def ask() -> None:
        sizes.extend(len(raw(client, LARGE, "identity")[1]) for _ in range(3))
        done.set()

    thread = threading.Thread(target=ask)
    thread.start()
    answered = 0
    while not done.is_set():
        assert client.get("/livez").json() == {"status": "alive"}
        answered += 1
    thread.join()
    assert answered >= 3
    assert len(sizes) == 3


def test_an_answer_that_nobody_wants_any_more_is_not_written_to_its_end() -> None:
    stop = Stop()
    stop.set(DeadlineExceeded("the deadline has passed"))
    with pytest.raises(DeadlineExceeded):
        make_body({"numbers": np.zeros(100_000)}, accepts_gzip=False, stop=stop)
    make_body({"numbers": np.zeros(10)}, accepts_gzip=False, stop=stop)
