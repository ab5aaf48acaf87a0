"""`plan_many` of both clients: every line once, and what a broken connection left once more."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.client import (
    AsyncPlannerClient,
    BatchFailure,
    BatchPlan,
    BatchProblem,
    PlanBatchRequest,
    PlannerClient,
    RequestRefused,
)
from app.main import create_app
from app.settings import Settings
from app.wire.problems import ProblemDetails
from tests.served import running

Line = BatchPlan | BatchFailure
Ask = Callable[..., list[Line]]


def request(count: int, **fields: Any) -> PlanBatchRequest:
    problems = [
        BatchProblem(initial_state=(0, 0), target_state=(0.001 * i, 0)) for i in range(count)
    ]
    shared = {"method": "uniform", "num_candidates": 2, "seed": 3, **fields}
    return PlanBatchRequest.model_validate({"problems": problems, **shared})


def blocking(asked: PlanBatchRequest, url: str = "http://nowhere", **options: Any) -> list[Line]:
    with PlannerClient(url, **options) as client:
        return list(client.plan_many(asked))


def asynchronous(
    asked: PlanBatchRequest, url: str = "http://nowhere", **options: Any
) -> list[Line]:
    async def plan() -> list[Line]:
        async with AsyncPlannerClient(url, **options) as client:
            return [line async for line in client.plan_many(asked)]

    return asyncio.run(plan())


with_both_clients = pytest.mark.parametrize("ask", [blocking, asynchronous])


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where a service without models is."""
    settings = Settings(model_store=tmp_path_factory.mktemp("empty"))
    with running(create_app(settings)) as url, PlannerClient(url) as client:
        client.wait_until_ready()
        yield url


class Broken(httpx.SyncByteStream, httpx.AsyncByteStream):
    """A body that breaks off, in the middle of a line."""

    def __init__(self, text: str) -> None:
        self._text = text.encode()

    def __iter__(self) -> Iterator[bytes]:
        yield self._text
        raise httpx.ReadError("gone")

    async def __aiter__(self) -> AsyncIterator[bytes]:
        for part in self:
            yield part


class Breaking(httpx.MockTransport):
    """A service that answers the last problem first, and breaks off after some lines."""

    def __init__(self, *lines_before_it_breaks: int, ends_in_order: bool = False) -> None:
        self.asked: list[list[dict[str, Any]]] = []
        breaks = iter(lines_before_it_breaks)

        def handle(request: httpx.Request) -> httpx.Response:
            problems = json.loads(request.content)["problems"]
            self.asked.append(problems)
            lines = [
                json.dumps({"index": index, "problem": told(problem["seed"])}) + "\n"
                for index, problem in reversed(list(enumerate(problems)))
            ]
            kept = next(breaks, len(lines))
            kind = {"Content-Type": "application/x-ndjson"}
            text = "".join(lines[:kept])
            if kept == len(lines) or ends_in_order:
                return httpx.Response(200, headers=kind, text=text)
            return httpx.Response(200, headers=kind, stream=Broken(text + '{"index": '))

        super().__init__(handle)


def told(seed: int) -> dict[str, Any]:
    """Return a problem that says which seed was asked for."""
    return ProblemDetails(
        type="about:blank", title="no", status=422, detail=str(seed), instance="/plan_batch"
    ).model_dump(exclude_none=True)


@with_both_clients
def test_every_problem_has_a_line_and_a_bad_one_says_so(url: str, ask: Ask) -> None:
    asked = request(30)
    asked.problems[7] = BatchProblem(initial_state=(0, 0), target_state=(0, 0))
    asked.problems[7].target_state = (float("1e9"), 0.0)  # past the client's own check

    lines = {line.index: line for line in ask(asked, url)}

    assert set(lines) == set(range(30))
    failure = lines.pop(7)
    assert isinstance(failure, BatchFailure)
    assert failure.problem.errors is not None
    assert failure.problem.errors[0].pointer == "/problems/7/target_state/0"
    assert all(isinstance(line, BatchPlan) for line in lines.values())


@with_both_clients
def test_the_seeds_are_those_of_the_service(url: str, ask: Ask) -> None:
    body = request(5).model_dump(mode="json", exclude_none=True)
    text = httpx.post(f"{url}/plan_batch", json=body).text
    seeds = {line["index"]: line["seed"] for line in map(json.loads, text.splitlines())}
    lines = ask(request(5), url)
    assert {line.index: line.seed for line in lines if isinstance(line, BatchPlan)} == seeds


@with_both_clients
def test_a_refusal_of_all_is_raised(url: str, ask: Ask) -> None:
    with pytest.raises(RequestRefused, match="/num_candidates"):
        ask(request(3, num_candidates=10_000), url)


@with_both_clients
@pytest.mark.parametrize("ends_in_order", [False, True])
def test_what_a_broken_connection_left_is_asked_for_again(ask: Ask, ends_in_order: bool) -> None:
    whole, service = Breaking(), Breaking(4, 0, 1, ends_in_order=ends_in_order)
    expected = {line.index: line for line in ask(request(10), transport=whole)}

    lines = ask(request(10), transport=service)

    assert {line.index: line for line in lines} == expected
    assert len(lines) == 10
    assert [len(problems) for problems in service.asked] == [10, 6, 6, 5]
    assert service.asked[1] == whole.asked[0][:6]


@with_both_clients
def test_patience_ends_where_no_line_comes_any_more(ask: Ask) -> None:
    service = Breaking(*[1, *[0] * 1000])
    with pytest.raises(httpx.TransportError):
        ask(request(3), transport=service, patience_s=0.3)
    assert len(service.asked) > 1


def test_who_takes_no_more_lines_leaves(model_store: Path) -> None:
    with (
        running(create_app(Settings(model_store=model_store))) as url,
        PlannerClient(url) as client,
    ):
        client.wait_until_ready()
        lines = client.plan_many(request(10_000))
        assert next(lines)
        lines.close()  # type: ignore[attr-defined]  # it is a generator
        assert isinstance(next(client.plan_many(request(1))), BatchPlan)
