"""Control sessions over a WebSocket: how soon a control comes, beside a large plan and others."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager
from itertools import count
from statistics import median
from time import perf_counter
from typing import Any

import httpx
import numpy as np
from websockets.asyncio.client import ClientConnection, connect

from app.benchmark.pairing import median_ms
from app.launch import launch
from app.planning.control import RecedingHorizon
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System

STEPS = 2000
"""Of the session whose round trips are timed."""
LARGE = 512
"""K of the request that runs beside it without pause."""
SESSIONS, SECONDS = 50, 10.0
CONNECTING_SECONDS = 2.0
TARGETS = (0.3, -0.3)
MACHINE = System(static_friction=0.78, coulomb_friction=0.66)
"""The simulated one; its controller believes the default plant."""
STEPS_TO_TARGET = 100


def control() -> Iterator[str]:
    """Time steps in this process and over a WebSocket; yield a Markdown list."""
    yield f"- a step of receding_horizon in this process: {_in_process():.3f} ms (median)"
    with launch("app", "serve", "--log-level", "error") as server:
        yield from asyncio.run(_over_sockets(server.url))


def _in_process() -> float:
    controller, model, goal = RecedingHorizon(), System(), Goal(0.2, 40)
    begun = control_step(controller, model, Measurement(0.0, 0.0), goal).memory
    return median_ms(lambda: control_step(controller, model, Measurement(0.0, 0.01), goal, begun))


async def _over_sockets(url: str) -> list[str]:
    lines = []
    await _drive(url, STEPS // 10)
    for where in ("on an idle service", f"beside K = {LARGE} of action_diffusion without a pause"):
        if where.startswith("beside"):
            async with _large_plans(url):
                seconds, late = await _drive(url, STEPS)
        else:
            seconds, late = await _drive(url, STEPS)
        p99 = float(np.quantile(seconds, 0.99))
        lines.append(
            f"- a step over WS /control {where}: {1e3 * median(seconds):.2f} ms (median), "
            f"{1e3 * p99:.2f} ms (99 %), {late} of {len(seconds)} late"
        )
    steps = round(SECONDS / MACHINE.time_step)
    offsets = np.linspace(0.0, MACHINE.time_step, SESSIONS, endpoint=False)
    begins = perf_counter() + CONNECTING_SECONDS + offsets
    driven = await asyncio.gather(*(_drive(url, steps, begin) for begin in begins.tolist()))
    worst = max(max(seconds) for seconds, _ in driven)
    lines.append(
        f"- {SESSIONS} sessions at {1 / MACHINE.time_step:.0f} Hz for {SECONDS:.0f} s: "
        f"{sum(late for _, late in driven)} of {SESSIONS * steps} steps late, "
        f"{1e3 * worst:.1f} ms at worst"
    )
    return lines


async def _drive(url: str, steps: int, begin: float | None = None) -> tuple[list[float], int]:
    """Control a simulated machine: in its time from `begin` on, or as fast as it goes.

    Returns:
        How long each control took to come, s; and how many came later than a time step, by the
        service's clock or this one.
    """
    seconds, late = [], 0
    state = np.zeros(2)
    async with connect(url.replace("http", "ws", 1) + "/control", compression=None) as socket:
        start = {"type": "start", "target_state": [TARGETS[0], 0.0], "include": []}
        await _ask(socket, start)
        for step in range(steps):
            if step % STEPS_TO_TARGET == STEPS_TO_TARGET - 1:
                target = TARGETS[step // STEPS_TO_TARGET % 2]
                await _ask(socket, {"type": "target", "target_state": [-target, 0.0]})
            if begin is not None:
                await asyncio.sleep(begin + step * MACHINE.time_step - perf_counter())
            asked = perf_counter()
            told = await _ask(
                socket, {"type": "measure", "position": state[0], "velocity": state[1]}
            )
            seconds.append(perf_counter() - asked)
            late += bool(told["late"]) or seconds[-1] > MACHINE.time_step
            state = rollout(MACHINE, state, np.array([[told["control"]]]))[0, -1]
        await _ask(socket, {"type": "stop"})
    return seconds, late


async def _ask(socket: ClientConnection, message: Mapping[str, object]) -> dict[str, Any]:
    await socket.send(json.dumps(message))
    told: dict[str, Any] = json.loads(await socket.recv())
    assert told["type"] != "error", told
    return told


@asynccontextmanager
async def _large_plans(url: str) -> AsyncIterator[None]:
    """Keep a large request under way until the context ends."""

    async def ask() -> None:
        async with httpx.AsyncClient(base_url=url, timeout=60) as client:
            for seed in count():
                body = {
                    "initial_state": [0.0, 0.0],
                    "target_state": [0.5, 0.0],
                    "num_candidates": LARGE,
                    "seed": seed,
                    "include": [],
                }
                (await client.post("/plan", json=body)).raise_for_status()

    asking = asyncio.create_task(ask())
    try:
        yield
    finally:
        asking.cancel()
