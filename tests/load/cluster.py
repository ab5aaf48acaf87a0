"""The service on Ray Serve while its replicas are killed, one after the other."""

import asyncio
import random
from collections import Counter
from pathlib import Path
from time import perf_counter

from app.launch import launch
from tests.deploy.service import KILLED
from tests.load.client import Answer, ServiceClient
from tests.load.reference import TOLERANCE, Likeness, Pool
from tests.load.session_clients import BROKEN, UNLIKE, SessionClients
from tests.load.store import ChangingStore
from tests.load.verdict import Verdict

NUM_CLIENTS = 4
NUM_QUESTIONS = 40
REPLICAS = 2
LONGEST_SECONDS = 0.5
"""Of a question."""
PATIENCE_SECONDS = 60.0
BUSY = (0, 429, 503)
"""Statuses after which a client comes back, with the same seed."""
MOST_STOPPED_SECONDS = 2.0


async def cluster(seconds: float, kill_every: float, seed: int, folder: Path) -> Verdict:
    """Ask the plain service, then a cluster whose replicas die, and compare.

    Args:
        seconds: how long.
        kill_every: seconds between two deaths.
        seed: decides what is asked.
        folder: empty; for the store and the services' logs.
    """
    store = ChangingStore(folder)
    log_file = folder / "server.log"
    chosen = ["--model-store", str(store.path)]
    pool = Pool(seed, NUM_QUESTIONS, LONGEST_SECONDS)
    with log_file.open("wb") as output:
        with launch("app", "serve", *chosen, output=output) as server:
            async with ServiceClient(server.url) as service:
                unlike = await pool.ask_all(service, store.version)
        arguments = ["--replicas", str(REPLICAS), "--kill-every", str(kill_every)]
        with launch("tests.deploy.service", *arguments, *chosen, output=output) as server:
            sessions = SessionClients(server.url, seed)
            crowd = _Crowd(server.url, pool, seed)
            end = perf_counter() + seconds
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(sessions.go_on_until(end))
                tasks.create_task(crowd.go_on_until(end))
            deaths = log_file.read_text(errors="replace").count(KILLED)
    verdict = Verdict("Replicas of a cluster that are killed")
    verdict.check("answers of the plain service that differ the second time", unlike)
    crowd.check(verdict)
    for check in (UNLIKE, BROKEN):
        verdict.check(check, sessions.surprises[check])
    verdict.check(
        "a session waited for a control", sessions.longest_wait, MOST_STOPPED_SECONDS, "s"
    )
    verdict.note("replicas killed", f"{deaths}")
    verdict.note("sessions", ", ".join(f"{n} x {event}" for event, n in sessions.events.items()))
    for number, example in enumerate(sessions.examples[:5], 1):
        verdict.note(f"surprise of a session {number}", example)
    return verdict


class _Crowd:
    """Clients that ask what the plain service has answered, and come back where they are told to.

    Args:
        url: of the cluster.
        pool: of questions with answers.
        seed: decides which is asked when.
    """

    def __init__(self, url: str, pool: Pool, seed: int) -> None:
        self._url = url
        self._pool = pool
        self._rng = random.Random(f"crowd {seed}")
        self._statuses: Counter[int] = Counter()
        self._likeness: Counter[Likeness] = Counter()
        self._lost: list[str] = []
        self._longest = 0.0

    async def go_on_until(self, end: float) -> None:
        async with ServiceClient(self._url) as service, asyncio.TaskGroup() as clients:
            for _ in range(NUM_CLIENTS):
                clients.create_task(self._be_a_client(service, end))

    def check(self, verdict: Verdict) -> None:
        verdict.check("requests without an answer", len(self._lost))
        verdict.check(
            f"plans more than {TOLERANCE:g} m/s² from the plain service's",
            self._likeness[Likeness.DIFFERENT],
        )
        busy = sum(self._statuses[status] for status in BUSY)
        verdict.check("requests that were not answered at once", busy)
        verdict.note(
            "answers", ", ".join(f"{n} x {status}" for status, n in sorted(self._statuses.items()))
        )
        same, close = (self._likeness[kind] for kind in (Likeness.SAME, Likeness.CLOSE))
        verdict.note("plans like the plain service's", f"{same} bit by bit, {close} nearly")
        verdict.note("longest wait for a plan", f"{self._longest:.2f} s")
        for number, example in enumerate(self._lost[:5], 1):
            verdict.note(f"lost {number}", example)

    async def _be_a_client(self, service: ServiceClient, end: float) -> None:
        while perf_counter() < end:
            index = self._rng.randrange(len(self._pool.questions))
            began = perf_counter()
            answer = await self._ask(service, index)
            self._longest = max(self._longest, perf_counter() - began)
            if answer.status != 200 or not answer.is_own:
                self._lost.append(str(answer)[:300])
            else:
                self._likeness[self._pool.compare(index, answer)] += 1

    async def _ask(self, service: ServiceClient, index: int) -> Answer:
        asked = self._pool.questions[index]
        until = perf_counter() + PATIENCE_SECONDS
        while True:
            answer = await service.ask(asked.route, asked.body)
            self._statuses[answer.status] += 1
            if answer.status not in BUSY or perf_counter() > until:
                return answer
            await asyncio.sleep(0.2)
