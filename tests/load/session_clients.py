"""Clients that control machines over a WebSocket: in time, late, hanging up, and out of order."""

import asyncio
import json
import random
from collections import Counter
from functools import cache
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from app.planning.control import RecedingHorizon
from app.planning.control.simulation import ToldOf, TrueMachine, simulate
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from tests.load.client import Metrics
from tests.load.verdict import Verdict

NUM_CLIENTS = 5
SHARE_HANGING_UP, SHARE_BAD_MESSAGES, SHARE_LATE = 0.2, 0.2, 0.02
"""Of sessions, the first; of steps, the others."""
STEPS = 80
MODEL, TRUTH = System(), System(0.78, 0.66)
TARGETS = (-0.3, -0.1, 0.1, 0.2, 0.4)
PATIENCE_SECONDS = 30.0
LATE_SECONDS = 0.3
STEP_MS = 1e3 * MODEL.time_step
ROUNDING_MS = 1e-3
"""A session's times are told to three digits."""
UNLIKE = "controls of sessions that differ from those made alone"
NOT_REFUSED = "bad messages of sessions that were not refused as they should be"
BROKEN = "sessions that ended though nobody ended them"
START = {"type": "start", "target_state": [0.0, 0.0], "include": []}


class Bad(NamedTuple):
    """A message that is to be refused, and leaves its session as it was."""

    text: str | bytes
    status: int


BAD = [
    Bad("{", 400),
    Bad(b"\xff\xfe", 400),
    Bad("[" * 5000, 400),
    Bad("[]", 422),
    Bad('{"type": "measure", "position": "here"}', 422),
    Bad('{"type": "measure", "position": 1e999}', 422),
    Bad('{"type": "measure", "position": 0, "velocity": 0, "step": 1000000}', 409),
    Bad('{"type": "target", "target_state": [0, 1]}', 422),
    Bad(json.dumps(START), 409),
    Bad('{"type": "dance"}', 422),
]


class SessionClients:
    """A few such clients beside those of a run, and what came of them.

    Args:
        url: of the service.
        seed: decides what they do.
    """

    def __init__(self, url: str, seed: int) -> None:
        self._url = url.replace("http", "ws", 1) + "/control"
        self._rng = random.Random(f"sessions {seed}")
        self.events: Counter[str] = Counter()
        self.surprises: Counter[str] = Counter()
        self.examples: list[str] = []
        self.longest_wait = 0.0
        """Of a control, s."""
        # Now: whoever loads kernels amid a run sends all that is due meanwhile at once.
        for target in TARGETS:
            controls_to(target)

    async def go_on_until(self, end: float) -> None:
        """Open one session after the other until then, by `perf_counter`."""

        async def be_a_client() -> None:
            while perf_counter() < end:
                await self._be_in_session()

        async with asyncio.TaskGroup() as clients:
            for _ in range(NUM_CLIENTS):
                clients.create_task(be_a_client())

    def check(self, verdict: Verdict, after: Metrics) -> None:
        """Add what has to be so; `after` is a reading when all sessions are over."""
        for check in (UNLIKE, NOT_REFUSED, BROKEN):
            verdict.check(check, self.surprises[check])
        verdict.check("sessions left over", after.total("breakaway_control_sessions"))
        verdict.check(
            "steps of sessions that came late", self.events["late controls"], is_timing=True
        )
        done = ", ".join(f"{n} x {event}" for event, n in sorted(self.events.items()))
        verdict.note("sessions", done or "none")
        for number, example in enumerate(self.examples[:5], 1):
            verdict.note(f"surprise of a session {number}", example)

    async def _be_in_session(self) -> None:
        target = self._rng.choice(TARGETS)
        hangs_up = self._rng.random() < SHARE_HANGING_UP
        steps = self._rng.randrange(STEPS) if hangs_up else STEPS
        try:
            async with (
                asyncio.timeout(PATIENCE_SECONDS + STEPS * MODEL.time_step),
                connect(self._url, compression=None, open_timeout=PATIENCE_SECONDS) as socket,
            ):
                await self._control(socket, target, steps)
                if hangs_up:
                    self.events["hung up"] += 1
                    socket.transport.abort()
                    return
                ended = await self._ask(socket, {"type": "stop"})
                if ended["type"] != "ended" or ended["step"] != STEPS:
                    self._surprise(BROKEN, ended)
                self.events["stopped"] += 1
        except (WebSocketException, OSError, TimeoutError) as error:
            self._surprise(BROKEN, repr(error))

    async def _control(self, socket: ClientConnection, target: float, steps: int) -> None:
        """Control a simulated machine at its own pace."""
        begun = await self._ask(socket, START | {"target_state": [target, 0.0]})
        if begun["type"] != "started":
            self._surprise(BROKEN, begun)
            return
        state = np.zeros(2)
        for control in controls_to(target)[:steps]:
            due = perf_counter() + MODEL.time_step
            if self._rng.random() < SHARE_BAD_MESSAGES:
                await self._send_bad(socket)
            if self._rng.random() < SHARE_LATE:
                self.events["late measurements"] += 1
                await asyncio.sleep(LATE_SECONDS)
            asked = perf_counter()
            told = await self._ask(
                socket, {"type": "measure", "position": state[0], "velocity": state[1]}
            )
            self.longest_wait = max(self.longest_wait, perf_counter() - asked)
            if told.get("control") != control:
                self._surprise(UNLIKE, (target, control, told))
                return
            self.events["controls"] += 1
            self.events["late controls"] += told["late"]
            over = told["timing_ms"]["total"] - STEP_MS
            if told["late"] != (over > 0) and abs(over) > ROUNDING_MS:
                self._surprise(UNLIKE, told)
            state = rollout(TRUTH, state, np.array([[control]]))[0, -1]
            await asyncio.sleep(max(0.0, due - perf_counter()))

    async def _send_bad(self, socket: ClientConnection) -> None:
        bad = self._rng.choice(BAD)
        self.events["bad messages"] += 1
        told = await self._ask(socket, bad.text)
        if (told["type"], told.get("status")) != ("error", bad.status):
            self._surprise(NOT_REFUSED, (bad, told))

    async def _ask(self, socket: ClientConnection, message: Any) -> dict[str, Any]:
        text = message if isinstance(message, str | bytes) else json.dumps(message)
        await socket.send(text)
        told: dict[str, Any] = json.loads(await socket.recv())
        return told

    def _surprise(self, check: str, what: object) -> None:
        self.surprises[check] += 1
        self.examples.append(f"{check}: {str(what)[:300]}")


@cache
def controls_to(target: float) -> list[float]:
    """Return the controls that a session has to give on its way to a target, made alone."""
    told = ToldOf(MODEL, target)
    runs = simulate(TrueMachine(TRUTH), np.zeros(2), RecedingHorizon(), told, STEPS, [0])
    controls: list[float] = runs.controls[0].tolist()
    return controls
