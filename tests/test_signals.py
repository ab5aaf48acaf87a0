"""The life of the server process: how it ends, begins again, and takes new models."""

import contextlib
import json
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

from app.launch import START_SECONDS, launch
from tests.metrics import pending
from tests.served import wait_until
from tests.stores import publish_version

LONG = {
    "initial_state": [0, 0],
    "target_state": [0.5, 0],
    "method": {"name": "cem", "iterations": 1000},
    "num_candidates": 800,
    "seed": 1,
}
"""Half a second or more."""
VERY_LONG = LONG | {"num_candidates": 4000, "horizon": 400}
"""A minute."""
SAMPLED = {
    "initial_state": [0, 0],
    "target_state": [0.5, 0],
    "num_candidates": 200,
    "method": {"name": "action_diffusion", "sampler": "ddim", "steps": 100},
    "seed": 1,
}

Process = subprocess.Popen[bytes]
Start = Callable[..., tuple[Process, httpx.Client]]


@pytest.fixture
def start(model_store: Path) -> Iterator[Start]:
    """Return the road to a ready server process and a client of it."""
    with contextlib.ExitStack() as stack:

        def start(
            store: Path = model_store, port: int | None = None
        ) -> tuple[Process, httpx.Client]:
            server = stack.enter_context(
                launch("app", "serve", "--model-store", str(store), port=port)
            )
            client = httpx.Client(base_url=server.url, timeout=START_SECONDS)
            return server.process, stack.enter_context(client)

        yield start


@pytest.fixture
def threads() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor() as threads:
        yield threads


def wait_until_begun(client: httpx.Client, futures: list[Future[Any]]) -> None:
    """Wait until the service is at work on those."""
    wait_until(lambda: pending(client) == len(futures))
    assert not any(future.done() for future in futures)


def test_sigterm_finishes_what_was_taken_on_and_takes_on_no_more(
    start: Start, threads: ThreadPoolExecutor
) -> None:
    process, client = start()
    alone = {"long": client.post("/plan", json=LONG), "sampled": client.post("/plan", json=SAMPLED)}
    futures = {
        name: threads.submit(client.post, "/plan", json=json.loads(answer.request.content))
        for name, answer in alone.items()
    }
    wait_until_begun(client, list(futures.values()))

    process.send_signal(signal.SIGTERM)
    wait_until(lambda: client.get("/readyz").status_code == 503)
    assert client.get("/livez").is_success
    refused = client.post("/plan", json=LONG)

    assert refused.status_code == 503
    assert "draining" in refused.json()["detail"]
    assert int(refused.headers["Retry-After"]) >= 1
    for name, future in futures.items():
        answer = future.result()
        assert answer.status_code == 200
        assert answer.json()["controls"] == alone[name].json()["controls"]
    assert process.wait(START_SECONDS) == -signal.SIGTERM


def test_a_second_signal_ends_the_server_at_once(start: Start, threads: ThreadPoolExecutor) -> None:
    process, client = start()
    futures = [threads.submit(client.post, "/plan", json=VERY_LONG)]
    wait_until_begun(client, futures)

    process.send_signal(signal.SIGTERM)
    wait_until(lambda: client.get("/readyz").status_code == 503)
    process.send_signal(signal.SIGTERM)

    assert process.wait(START_SECONDS) == -signal.SIGTERM
    with contextlib.suppress(httpx.TransportError):  # it may not have had the time to say so
        assert futures[0].result().status_code == 503


def test_a_killed_server_starts_again_on_its_port_as_if_nothing_had_been(
    start: Start, threads: ThreadPoolExecutor
) -> None:
    process, client = start()
    before = client.post("/plan", json=SAMPLED).json()
    future = threads.submit(client.post, "/plan", json=VERY_LONG)
    wait_until_begun(client, [future])
    process.kill()
    with pytest.raises(httpx.TransportError):
        future.result()
    process.wait()

    _, client = start(port=client.base_url.port)

    assert client.post("/plan", json=SAMPLED).json()["controls"] == before["controls"]


@pytest.fixture
def store(model_store: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(model_store, tmp_path / "store"))


def versions(client: httpx.Client) -> list[str]:
    return [model["version"] for model in client.get("/models").json()]


def test_sighup_takes_new_models_and_keeps_the_old_ones_if_one_is_bad(
    start: Start, store: Path, threads: ThreadPoolExecutor
) -> None:
    process, client = start(store=store)
    assert versions(client) == ["1"]
    before = threads.submit(client.post, "/plan", json=SAMPLED)
    wait_until_begun(client, [before])

    publish_version(store, 2)
    process.send_signal(signal.SIGHUP)
    wait_until(lambda: versions(client) == ["2", "1"])
    assert before.result().json()["model"]["version"] == "1"
    assert client.post("/plan", json=SAMPLED).json()["model"]["version"] == "2"

    bad = publish_version(store, 3, sha256="0" * 64)
    publish_version(store, 4)
    process.send_signal(signal.SIGHUP)
    for _ in range(20):
        assert client.post("/plan", json=LONG | {"method": "uniform"}).is_success
    assert versions(client) == ["2", "1"]
    assert client.get("/readyz").is_success

    shutil.rmtree(bad)
    process.send_signal(signal.SIGHUP)
    wait_until(lambda: versions(client) == ["4", "2", "1"])

    shutil.rmtree(store / "tiny" / "1")
    process.send_signal(signal.SIGHUP)
    wait_until(lambda: versions(client) == ["4", "2"])
    assert client.post("/plan", json=SAMPLED | {"model": "tiny/1"}).status_code == 404


def test_a_batch_that_was_begun_is_finished_when_the_server_ends(start: Start) -> None:
    process, client = start()
    problems = [{"initial_state": [0, 0], "target_state": [0.001 * i, 0]} for i in range(400)]
    body = {"problems": problems, "method": "cem", "reachability": False, "include": []}
    with client.stream("POST", "/plan_batch", json=body) as response:
        lines = response.iter_lines()
        indices = {json.loads(next(lines))["index"]}
        process.send_signal(signal.SIGTERM)
        wait_until(lambda: httpx.get(client.base_url.join("/readyz")).status_code == 503)
        indices |= {json.loads(line)["index"] for line in lines}
    assert indices == set(range(400))
    assert process.wait(START_SECONDS) == -signal.SIGTERM


@pytest.mark.slow
def test_ten_thousand_problems_take_no_more_memory_than_a_thousand(start: Start) -> None:
    process, client = start()
    memory = psutil.Process(process.pid).memory_info

    def most_memory(count: int) -> float:
        """Return the most that is resident while so many are asked for, MB."""
        problems = [{"initial_state": [0, 0], "target_state": [1e-4 * i, 0]} for i in range(count)]
        body = {"problems": problems, "method": "dataset_prior", "include": ["states"]}
        most = 0
        with client.stream("POST", "/plan_batch", json=body | {"refine": True}) as response:
            for _ in response.iter_lines():
                most = max(most, memory().rss)
        return most / 1e6

    most_memory(1000)
    thousand, ten_thousand = most_memory(1000), most_memory(10_000)
    # The problems themselves are kept as they were read: a kilobyte each.
    assert ten_thousand < thousand + 15
