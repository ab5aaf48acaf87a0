"""Several targets as events: a segment at a time, then the whole, or what went wrong."""

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from app.planning.planner import plan_multistep
from app.planning.problem import PlanningError
from app.serving.refusals import DeadlineExceeded
from app.settings import Settings
from tests.api.test_errors import assert_problem
from tests.api.test_plan import without_timing
from tests.metrics import value
from tests.served import serving, wait_until, wait_until_ready

ASKED: dict[str, Any] = {
    "initial_state": [0, 0],
    "targets": [[0.4, 0], [-0.4, 0], [0.2, 0]],
    "method": "cem",
    "seed": 7,
}
SLOW = ASKED | {
    "targets": [[0.1 * place, 0] for place in range(64)],
    "method": {"name": "cem", "iterations": 1000},
    "num_candidates": 400,
}
STREAM = {"Accept": "text/event-stream"}


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A service without models, of its own metrics."""
    with serving(Settings(model_store=tmp_path_factory.mktemp("store"))) as client:
        wait_until_ready(client)
        yield client


def events(answer: httpx.Response) -> Iterator[tuple[str, Any]]:
    for text in answer.iter_lines():
        name, _, content = text.partition(": ")
        if name == "event":
            kind = content
        elif name == "data":
            yield kind, json.loads(content)


def test_segments_come_one_by_one_and_then_the_whole(client: httpx.Client) -> None:
    whole = client.post("/plan_multistep", json=ASKED).json()
    with client.stream("POST", "/plan_multistep", json=ASKED, headers=STREAM) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        assert answer.headers["cache-control"] == "no-store"
        *segments, (kind, last) = events(answer)
    assert [kind for kind, _ in segments] == ["segment"] * 3
    assert kind == "plan"
    assert [segment for _, segment in segments] == last["segments"]
    assert without_timing(last) == without_timing(whole)


def test_the_first_segment_is_there_before_the_last_is_planned(empty: httpx.Client) -> None:
    def done() -> float:
        text = empty.get("/metrics").text
        return value(text, "breakaway_requests_total", route="/plan_multistep")

    before = done()
    with empty.stream("POST", "/plan_multistep", json=SLOW, headers=STREAM) as answer:
        found = events(answer)
        kind, segment = next(found)
        assert kind == "segment"
        assert segment["controls"]
        assert done() == before
    # The client has gone: the rest is not planned, which would take minutes.
    wait_until(lambda: done() == before + 1)


@pytest.mark.parametrize(
    ("fields", "status"),
    [({"targets": []}, 422), ({"model": "none"}, 404), ({"deadline_ms": 1}, 429)],
)
def test_what_is_refused_is_answered_as_ever(
    client: httpx.Client, fields: dict[str, Any], status: int
) -> None:
    answer = client.post("/plan_multistep", json=SLOW | fields, headers=STREAM)
    assert_problem(answer, status)


@pytest.mark.parametrize(
    ("error", "status"),
    [(DeadlineExceeded("too late"), 504), (PlanningError("no luck"), 500), (KeyError("bug"), 500)],
)
def test_what_goes_wrong_later_is_told_in_an_event(
    empty: httpx.Client, monkeypatch: pytest.MonkeyPatch, error: Exception, status: int
) -> None:
    def one_and_no_more(*arguments: Any) -> None:
        problem, targets, recipe, rng, stop, told = arguments
        plan_multistep(problem, targets[:1], recipe, rng, stop, told)
        raise error

    monkeypatch.setattr("app.serving.service.plan_multistep", one_and_no_more)
    with empty.stream("POST", "/plan_multistep", json=ASKED, headers=STREAM) as answer:
        assert answer.status_code == 200
        (first, _), (kind, problem) = events(answer)
    assert (first, kind) == ("segment", "problem")
    assert problem["status"] == status
    assert "bug" not in problem["detail"]


def test_an_accepted_stream_need_not_be_the_only_thing_accepted(client: httpx.Client) -> None:
    both = {"Accept": "application/json;q=0.5, text/event-stream"}
    answer = client.post("/plan_multistep", json=ASKED, headers=both)
    assert answer.headers["content-type"].startswith("text/event-stream")
    plain = client.post("/plan_multistep", json=ASKED, headers={"Accept": "*/*"})
    assert plain.headers["content-type"] == "application/json"
