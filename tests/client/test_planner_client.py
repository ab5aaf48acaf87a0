"""Both clients over real HTTP and over faked one: typed answers, clear refusals, patience."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.launch import free_port
from app.main import create_app
from app.planning.plant.machines import MACHINES
from app.serving.rates import Rates
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.answers import PlanResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest
from tests.served import running

STATES = {"initial_state": (0.0, 0.0), "target_state": (0.2, 0.0)}
UNIFORM = PlanRequest.model_validate({**STATES, "method": "uniform", "seed": 7})
NOWHERE = "http://nowhere"

Plan = Callable[..., PlanResponse]


def blocking(request: PlanRequest, url: str = NOWHERE, **options: Any) -> PlanResponse:
    with PlannerClient(url, **options) as client:
        return client.plan(request)


def asynchronous(request: PlanRequest, url: str = NOWHERE, **options: Any) -> PlanResponse:
    async def plan() -> PlanResponse:
        async with AsyncPlannerClient(url, **options) as client:
            return await client.plan(request)

    return asyncio.run(plan())


with_both_clients = pytest.mark.parametrize("plan", [blocking, asynchronous])


@pytest.fixture(scope="module")
def url(model_store: Path) -> Iterator[str]:
    """Where a service with the tiny model is."""
    with running(create_app(Settings(model_store=model_store))) as url:
        yield url


def in_process(request: PlanRequest) -> PlanResponse:
    service = PlanningService(Settings(), ModelStore([]), Engine(1), Rates())
    return service.plan(service.resolve(request))


def without_times(answer: PlanResponse) -> dict[str, Any]:
    return answer.model_dump(exclude={"timing_ms"})


class Script(httpx.MockTransport):
    """Answers with what it is given, one after the other, and remembers what it was asked."""

    def __init__(self, *answers: httpx.Response | Exception) -> None:
        self.asked: list[bytes] = []
        waiting = iter(answers)

        def handle(request: httpx.Request) -> httpx.Response:
            self.asked.append(request.content)
            answer = next(waiting)
            if isinstance(answer, Exception):
                raise answer
            return answer

        super().__init__(handle)


def answered() -> httpx.Response:
    return httpx.Response(200, text=in_process(UNIFORM).model_dump_json())


def unwilling(status: int, wait: str = "0") -> httpx.Response:
    problem = {
        "type": "about:blank",
        "title": "Not now",
        "status": status,
        "detail": "come back later",
        "instance": "/plan",
    }
    return httpx.Response(status, json=problem, headers={"Retry-After": wait})


@with_both_clients
@pytest.mark.parametrize(
    "fields",
    [
        {"method": "uniform", "include": ["states", "candidates"], "num_candidates": 4},
        {"method": {"name": "cem", "iterations": 3}, "initial": {"method": "dataset_prior"}},
        {"method": "dataset_prior", "refine": True, "objective": "control_energy"},
        {"method": "mppi", "system": {"static_friction": 0.65}, "horizon": 32},
        {"method": "cem", "system": "belt_cart", "pending_controls": [4.0, -4.0, 0.5]},
        {"method": "cem", "system": {"coulomb_friction": {"forward": 0.1, "backward": 0.6}}},
    ],
)
def test_the_answer_is_that_of_the_planner(url: str, plan: Plan, fields: dict[str, Any]) -> None:
    request = PlanRequest.model_validate({**STATES, "seed": 7, **fields})
    assert without_times(plan(request, url)) == without_times(in_process(request))


def test_both_clients_get_the_same_plan_from_a_model(url: str) -> None:
    request = PlanRequest.model_validate({**STATES, "seed": 7})
    answer = blocking(request, url)
    assert answer.model is not None
    assert answer.model.name == "tiny"
    assert without_times(answer) == without_times(asynchronous(request, url))


def test_both_clients_get_everything_else_alike(url: str) -> None:
    request = MultistepPlanRequest.model_validate(
        {"initial_state": (0.0, 0.0), "targets": [(0.2, 0.0), (0.0, 0.0)], "seed": 7}
    )

    async def asked() -> tuple[Any, ...]:
        async with AsyncPlannerClient(url) as client:
            await client.wait_until_ready()
            return (
                (await client.plan_multistep(request)).controls,
                await client.models(),
                await client.machines(),
                await client.info(),
            )

    with PlannerClient(url) as client:
        client.wait_until_ready()
        controls = client.plan_multistep(request).controls
        models, machines, info = client.models(), client.machines(), client.info()
    assert asyncio.run(asked()) == (controls, models, machines, info)
    assert len(controls) == 128
    assert [model.name for model in models] == ["tiny"]
    assert {machine.name: machine.system for machine in machines} == {
        name: machine.system for name, machine in MACHINES.items()
    }
    assert info.name == "breakaway"


@with_both_clients
def test_a_refusal_names_the_fields_at_fault(url: str, plan: Plan) -> None:
    too_large = PlanRequest.model_validate({**STATES, "num_candidates": 5000})
    with pytest.raises(RequestRefused, match=r"Invalid request \(422\).*at most 4096") as refused:
        plan(too_large, url)
    errors = refused.value.problem.errors
    assert errors is not None
    assert [error.pointer for error in errors] == ["/num_candidates"]


@with_both_clients
@pytest.mark.parametrize(
    ("status", "message"), [(404, r"Not Found \(404\)"), (500, r"Internal Server Error \(500\)")]
)
def test_something_else_at_that_address_is_shown(plan: Plan, status: int, message: str) -> None:
    script = Script(httpx.Response(status, html="<h1>Welcome to my home page</h1>"))
    with pytest.raises(RequestRefused, match=f"{message}.*home page") as refused:
        plan(UNIFORM, transport=script)
    assert refused.value.problem.instance == "/plan"
    assert len(script.asked) == 1


@with_both_clients
def test_a_busy_or_starting_service_is_asked_again(plan: Plan) -> None:
    script = Script(unwilling(429), unwilling(503), answered())
    answer = plan(UNIFORM, transport=script)
    assert without_times(answer) == without_times(in_process(UNIFORM))
    assert len(script.asked) == 3
    assert len(set(script.asked)) == 1


@with_both_clients
def test_without_a_seed_another_attempt_asks_for_the_same_plan(plan: Plan) -> None:
    request = PlanRequest.model_validate({**STATES, "method": "uniform"})
    seeds = []
    for _ in range(2):
        script = Script(httpx.ReadError("gone"), unwilling(503), answered())
        plan(request, transport=script)
        assert len(set(script.asked)) == 1
        seeds.append(PlanRequest.model_validate_json(script.asked[0]).seed)
    assert None not in seeds
    assert seeds[0] != seeds[1]


@with_both_clients
def test_the_seed_of_a_request_is_left_as_it_is(plan: Plan) -> None:
    script = Script(answered())
    plan(UNIFORM.model_copy(update={"seed": 0}), transport=script)
    assert PlanRequest.model_validate_json(script.asked[0]).seed == 0


def test_a_sequence_without_a_seed_is_sent_with_one() -> None:
    request = MultistepPlanRequest(initial_state=(0.0, 0.0), targets=[(0.2, 0.0)])
    script = Script(unwilling(422), unwilling(422))

    async def ask() -> None:
        async with AsyncPlannerClient(NOWHERE, transport=script) as client:
            await client.plan_multistep(request)

    with pytest.raises(RequestRefused), PlannerClient(NOWHERE, transport=script) as client:
        client.plan_multistep(request)
    with pytest.raises(RequestRefused):
        asyncio.run(ask())
    first, second = (MultistepPlanRequest.model_validate_json(body).seed for body in script.asked)
    assert None not in (first, second)
    assert first != second


@with_both_clients
@pytest.mark.parametrize(
    "failure",
    [
        httpx.ConnectError("refused"),
        httpx.RemoteProtocolError("Server disconnected without sending a response."),
    ],
)
def test_a_service_that_ends_meanwhile_is_asked_again(plan: Plan, failure: Exception) -> None:
    script = Script(failure, answered())
    assert plan(UNIFORM, transport=script).seed == 7
    assert len(script.asked) == 2


class BrokenOff(httpx.SyncByteStream, httpx.AsyncByteStream):
    """A body whose connection ends too soon."""

    def __iter__(self) -> Iterator[bytes]:
        yield b'{"method": '
        raise httpx.ReadError("the connection is gone")

    async def __aiter__(self) -> AsyncIterator[bytes]:
        for part in self:
            yield part


@with_both_clients
def test_an_answer_that_breaks_off_is_asked_for_again(plan: Plan) -> None:
    script = Script(httpx.Response(200, stream=BrokenOff()), answered())
    assert plan(UNIFORM, transport=script).seed == 7
    assert len(script.asked) == 2


@with_both_clients
@pytest.mark.parametrize("key", [None, "first-key-0123456789"])
def test_the_key_goes_along(plan: Plan, key: str | None) -> None:
    sent: list[str | None] = []

    def handle(request: httpx.Request) -> httpx.Response:
        sent.append(request.headers.get("authorization"))
        return unwilling(401)

    with pytest.raises(RequestRefused, match=r"\(401\)"):
        plan(UNIFORM, transport=httpx.MockTransport(handle), api_key=key)
    assert sent == [key and f"Bearer {key}"]


@with_both_clients
def test_patience_ends(plan: Plan) -> None:
    script = Script(unwilling(503, wait="60"), unwilling(503, wait="60"))
    with pytest.raises(RequestRefused, match=r"Not now \(503\): come back later"):
        plan(UNIFORM, transport=script, patience_s=0.01)
    assert len(script.asked) == 2


@with_both_clients
def test_patience_with_an_absent_service_ends(plan: Plan) -> None:
    with pytest.raises(httpx.ConnectError):
        plan(UNIFORM, f"http://127.0.0.1:{free_port()}", patience_s=0.1)


@with_both_clients
@pytest.mark.parametrize("status", [400, 404, 413, 422, 500])
def test_other_refusals_are_final(plan: Plan, status: int) -> None:
    script = Script(unwilling(status))
    with pytest.raises(RequestRefused):
        plan(UNIFORM, transport=script)
    assert len(script.asked) == 1


@with_both_clients
def test_an_answer_that_takes_too_long_is_not_asked_for_again(plan: Plan) -> None:
    script = Script(httpx.ReadTimeout("ten minutes"))
    with pytest.raises(httpx.ReadTimeout):
        plan(UNIFORM, transport=script)
    assert len(script.asked) == 1


@with_both_clients
def test_a_service_that_comes_back_is_waited_for(model_store: Path, plan: Plan) -> None:
    port = free_port()
    # Before: what FastAPI silences meanwhile, it silences in no other thread.
    app = create_app(Settings(model_store=model_store))
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(plan, UNIFORM, f"http://127.0.0.1:{port}")
        time.sleep(0.2)
        assert not asked.done()
        with running(app, port):
            answer = asked.result()
    assert without_times(answer) == without_times(in_process(UNIFORM))


def streamed(request: MultistepPlanRequest, url: str) -> list[Any]:
    with PlannerClient(url) as client:
        return list(client.stream_multistep(request))


def streamed_asynchronously(request: MultistepPlanRequest, url: str) -> list[Any]:
    async def stream() -> list[Any]:
        async with AsyncPlannerClient(url) as client:
            return [part async for part in client.stream_multistep(request)]

    return asyncio.run(stream())


@pytest.mark.parametrize("stream", [streamed, streamed_asynchronously])
def test_segments_are_iterated_over_and_the_whole_comes_last(
    stream: Callable[[MultistepPlanRequest, str], list[Any]], url: str
) -> None:
    asked = {"initial_state": (0, 0), "targets": [(0.1, 0), (0.2, 0)], "method": "cem", "seed": 1}
    *segments, whole = stream(MultistepPlanRequest.model_validate(asked), url)
    assert segments == whole.segments
    assert len(segments) == 2
    refused = MultistepPlanRequest.model_validate(asked | {"model": "none"})
    with pytest.raises(RequestRefused, match="none"):
        stream(refused, url)
