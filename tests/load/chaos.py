"""Clients that hang up, send rubbish and ask broken models, while models come and go."""

import asyncio
import json
import random
import signal
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from time import perf_counter

import httpx

from app.launch import ServerProcess, launch
from tests.load.client import PROBLEM, ROUTES, Answer, Metrics, ServiceClient
from tests.load.connections import request_head
from tests.load.large_clients import LargeClients
from tests.load.probe import Probes, probing
from tests.load.reference import TOLERANCE, Likeness, Pool
from tests.load.rubbish import GOOD, RUBBISH, SILENT_SECONDS, Rubbish, bad_bytes, send_bytes
from tests.load.scenario import Body
from tests.load.session_clients import SessionClients
from tests.load.store import NAN, RAISES, RELOADED, ChangingStore
from tests.load.verdict import Verdict

NUM_CLIENTS = 12
NUM_QUESTIONS = 60
SHARE_HANGING_UP, SHARE_RUBBISH, SHARE_BAD_MODELS = 0.2, 0.05, 0.04
SEND_TIMEOUT_SECONDS = 2
LONGEST_PATIENCE_SECONDS = 0.3
"""Of a client that hangs up."""
RELOAD_SECONDS = (10.0, 20.0)
"""Between two reloads; in a short run they come sooner, so that there are some."""
RELOADS_AT_LEAST = 6
DAMAGED_EVERY = 3
"""One in so many reloads finds a version that is not what its manifest says."""
REACTION_SECONDS = 60.0
"""How long a reload may take, in the middle of all that."""
LONGEST_WARM_UP_SECONDS = 60.0
SETTLING_SECONDS = 2.0
IDLE_SECONDS, IDLE_CORES = 1.0, 0.1
ENDING_SECONDS = 5.0
GROWTH_MB = 50.0
NUM_SURPRISES = 10
"""Shown of what should not have happened."""
NEVER_HANDLED = ("Exception in ASGI application", "never retrieved", "Fatal Python error")
"""What a log says of an error that nobody expected."""


@dataclass
class Tally:
    """What was done, and what came of it."""

    answers: Counter[tuple[str, int]] = field(default_factory=Counter)
    """By route and status; of plans only."""
    events: Counter[str] = field(default_factory=Counter)
    likeness: Counter[Likeness] = field(default_factory=Counter)
    surprises: Counter[str] = field(default_factory=Counter)
    """Checks that failed, and how often."""
    examples: list[str] = field(default_factory=list)
    """Of what should not have happened."""

    def surprise(self, check: str, what: object) -> None:
        """Note something that should not have happened."""
        self.surprises[check] += 1
        self.examples.append(f"{check}: {str(what)[:300]}")


UNLIKE_TWICE = "answers of the idle server that differ the second time"
BAD_ANSWER = "good requests without a plan of their own"
DIFFERENT = f"plans more than {TOLERANCE:g} m/s² from the idle server's"
BAD_MODEL = "broken models that got another answer than 500 planning-failed"
NOT_REFUSED = "rubbish that was not refused as it should be"
NOT_RELOADED = "reloads that did not do as they should"
SURPRISES = (BAD_ANSWER, DIFFERENT, BAD_MODEL, NOT_REFUSED, NOT_RELOADED)


async def chaos(seconds: float, seed: int, folder: Path) -> Verdict:
    """Start a service on a store of its own, and treat it badly.

    Args:
        seconds: how long, after a warm-up of up to a quarter of that.
        seed: decides what is done, though not when.
        folder: empty; for the store and the service's log.
    """
    store = ChangingStore(folder)
    log_file = folder / "server.log"
    settings = ["--model-store", str(store.path), "--send-timeout-s", str(SEND_TIMEOUT_SECONDS)]
    with (
        log_file.open("wb") as output,
        launch("app", "serve", *settings, output=output) as server,
    ):
        async with ServiceClient(server.url) as service:
            pool = Pool(seed, NUM_QUESTIONS, longest=seconds / 100)
            unlike = await pool.ask_all(service, store.version)
            run = _Chaos(server, log_file, service, store, pool, seed)
            await run.replace_model()
            unlike += await pool.ask_all(service, store.version)
            large_clients = LargeClients(service.connections.address, seed)
            session_clients = SessionClients(server.url, seed)
            before = await service.metrics()
            async with probing(server.url) as probes:
                await run.go_on(min(LONGEST_WARM_UP_SECONDS, seconds / 4))
                await asyncio.sleep(SETTLING_SECONDS)
                warm = await service.metrics()
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(large_clients.go_on_until(perf_counter() + seconds))
                    tasks.create_task(session_clients.go_on_until(perf_counter() + seconds))
                    tasks.create_task(run.go_on(seconds))
                await asyncio.sleep(SETTLING_SECONDS)
            after = await service.metrics()
            await asyncio.sleep(IDLE_SECONDS)
            idle = await service.metrics()
            is_ready = (await service.http.get("/readyz")).is_success
        # It ends when all that was taken on is done: soon, or something was left over.
        ending = server.end()
        verdict = Verdict(f"chaos: {NUM_CLIENTS} clients for {seconds:.0f} s")
        verdict.check(UNLIKE_TWICE, unlike)
        _check(verdict, run.tally, large_clients, before, after, probes)
        session_clients.check(verdict, after)
        verdict.check("not ready in the end", not is_ready)
        cores = (idle.cpu_seconds - after.cpu_seconds) / IDLE_SECONDS
        verdict.check("cores busy in the end", cores, IDLE_CORES)
        verdict.check("end on SIGTERM", ending, ENDING_SECONDS, "s", is_timing=True)
        verdict.check("resident memory grew", after.memory_mb - warm.memory_mb, GROWTH_MB, "MB")
        log = log_file.read_text()
        verdict.check("errors in the log", sum(log.count(phrase) for phrase in NEVER_HANDLED))
        verdict.note(
            "resident memory", f"{warm.memory_mb:.0f} MB before, {after.memory_mb:.0f} MB after"
        )
    return verdict


class _Chaos:
    """Everything that is done to the service.

    Args:
        server: its process.
        log_file: where it logs.
        service: asks it.
        store: its store.
        pool: questions whose answers are known.
        seed: decides what is done.
    """

    def __init__(
        self,
        server: ServerProcess,
        log_file: Path,
        service: ServiceClient,
        store: ChangingStore,
        pool: Pool,
        seed: int,
    ) -> None:
        self._server = server
        self._log_file = log_file
        self._service = service
        self._store = store
        self._pool = pool
        self._rng = random.Random(f"chaos {seed}")
        self.tally = Tally()

    async def go_on(self, seconds: float) -> None:
        """Do all that, for so long."""
        end = perf_counter() + seconds
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._reload_until(end, seconds / RELOADS_AT_LEAST))
            tasks.create_task(self._send_all_bad_requests())
            for _ in range(NUM_CLIENTS):
                tasks.create_task(self._be_a_client_until(end))

    async def _be_a_client_until(self, end: float) -> None:
        doings = [self._hang_up, self._send_rubbish, self._ask_broken_model, self._ask_well]
        shares = [SHARE_HANGING_UP, SHARE_RUBBISH, SHARE_BAD_MODELS]
        while perf_counter() < end:
            await self._rng.choices(doings, [*shares, 1 - sum(shares)])[0]()

    async def _ask_well(self) -> None:
        index = self._rng.randrange(len(self._pool.questions))
        asked = self._pool.questions[index]
        answer = await self._ask(asked.route, asked.body)
        if answer.status != 200 or not answer.is_own:
            self.tally.surprise(BAD_ANSWER, (asked.body, answer))
            return
        likeness = self._pool.compare(index, answer)
        self.tally.likeness[likeness] += 1
        if likeness is Likeness.DIFFERENT:
            self.tally.surprise(DIFFERENT, asked.body)

    async def _ask_broken_model(self) -> None:
        body = GOOD | {"model": self._rng.choice([RAISES, NAN])}
        answer = await self._ask("/plan", body)
        kind = answer.body["type"] if answer.content_type == PROBLEM else None
        self.tally.events["broken models asked"] += 1
        if (answer.status, kind) != (500, "urn:breakaway:problem:planning-failed"):
            self.tally.surprise(BAD_MODEL, answer)

    async def _ask(self, route: str, body: Body) -> Answer:
        answer = await self._service.ask(route, body)
        self.tally.answers[route, answer.status] += 1
        return answer

    async def _hang_up(self) -> None:
        asked = self._rng.choice(self._pool.questions)
        body = json.dumps(asked.body).encode()
        head = request_head(asked.route, len(body), {})
        self.tally.events["hung up"] += 1
        patience = self._rng.uniform(0, LONGEST_PATIENCE_SECONDS)
        await send_bytes(*self._service.connections.address, head + body, patience)

    async def _send_rubbish(self) -> None:
        if self._rng.random() < 0.5:
            await self._send_bad_request(self._rng.choice(RUBBISH))
        else:
            await self._send_bad_bytes()

    async def _send_all_bad_requests(self) -> None:
        for bad in RUBBISH:
            await self._send_bad_request(bad)

    async def _send_bad_request(self, bad: Rubbish) -> None:
        self.tally.events["bad requests"] += 1
        headers = {"Content-Type": bad.content_type}
        try:
            response = await self._service.http.request(
                bad.http_method, bad.route, content=bad.content, headers=headers
            )
        except httpx.TransportError as error:
            self.tally.surprise(NOT_REFUSED, (bad.name, repr(error)))
            return
        kind = response.headers.get("Content-Type")
        if (response.status_code, kind) != (bad.status, PROBLEM):
            self.tally.surprise(NOT_REFUSED, (bad.name, response.status_code, response.text))
        if bad.route in ROUTES and bad.http_method == "POST":
            self.tally.answers[bad.route, response.status_code] += 1

    async def _send_bad_bytes(self) -> None:
        content = bad_bytes(self._rng)
        self.tally.events["bad bytes"] += 1
        said = await send_bytes(*self._service.connections.address, content, SILENT_SECONDS)
        if said and not said.startswith(b"HTTP/1.1 4"):
            self.tally.surprise(NOT_REFUSED, (content[:100], said[:100]))

    async def _reload_until(self, end: float, longest_pause: float) -> None:
        for number in count(1):
            pause = min(longest_pause, self._rng.uniform(*RELOAD_SECONDS))
            if perf_counter() + pause > end:
                return
            await asyncio.sleep(pause)
            if number % DAMAGED_EVERY:
                await self.replace_model()
            else:
                await self._add_damaged_model()

    async def replace_model(self) -> None:
        """Put another version of the changing model in place, and see that it is taken."""
        self._store.replace()
        await self._reload("new version", self._uses_newest)

    async def _add_damaged_model(self) -> None:
        refusals = self._refusals()

        async def is_refused() -> bool:
            return self._refusals() > refusals and await self._uses_newest()

        self._store.add_broken()
        await self._reload("damaged version", is_refused)
        self._store.remove_broken()

    async def _reload(self, what: str, is_done: Callable[[], Awaitable[bool]]) -> None:
        self.tally.events[f"reloads, {what}"] += 1
        self._server.process.send_signal(signal.SIGHUP)
        try:
            async with asyncio.timeout(REACTION_SECONDS):
                while not await is_done():
                    await asyncio.sleep(0.1)
        except TimeoutError:
            self.tally.surprise(NOT_RELOADED, what)

    async def _uses_newest(self) -> bool:
        models = (await self._service.http.get("/models")).raise_for_status().json()
        versions = [model["version"] for model in models if model["name"] == RELOADED]
        return versions == [str(self._store.version)]

    def _refusals(self) -> int:
        return self._log_file.read_text().count("changed or damaged")


def _check(
    verdict: Verdict,
    tally: Tally,
    large_clients: LargeClients,
    before: Metrics,
    after: Metrics,
    probes: Probes,
) -> None:
    for status, number in large_clients.statuses.items():
        tally.answers["/plan", status] += number
    for check in SURPRISES:
        verdict.check(check, tally.surprises[check])
    failed_on_purpose = tally.events["broken models asked"]
    errors = sum(n for (_, status), n in tally.answers.items() if status >= 500)
    verdict.check("errors of the server (5xx) nobody asked for", errors - failed_on_purpose)
    # Who hung up cannot know what became of it; at most one request each.
    unknown = tally.events["hung up"] + tally.events["bad bytes"]
    theirs = Counter(after.answered) - Counter(before.answered)
    more, fewer = theirs - tally.answers, tally.answers - theirs
    open_ended = sum(n for (_, status), n in more.items() if status in (200, 400, 499))
    verdict.check(
        "answers that only one side has counted", fewer.total() + more.total() - open_ended
    )
    verdict.check("requests counted of those that hung up", open_ended, unknown)
    large_clients.check(verdict)
    verdict.check("/livez failed", probes.failures)
    statuses: Counter[int] = Counter()
    for (_, status), number in tally.answers.items():
        statuses[status] += number
    verdict.note("answers", ", ".join(f"{n} x {status}" for status, n in sorted(statuses.items())))
    dropped = sum(n for (_, status), n in more.items() if status == 499)
    verdict.note("noticed and dropped (499)", f"{dropped} of {open_ended} whose client hung up")
    verdict.note("done", ", ".join(f"{n} x {event}" for event, n in sorted(tally.events.items())))
    verdict.note(
        "plans like the idle server's",
        f"{tally.likeness[Likeness.SAME]} bit by bit, {tally.likeness[Likeness.CLOSE]} within "
        f"{TOLERANCE:g} m/s², {tally.likeness[Likeness.DIFFERENT]} not",
    )
    for number, example in enumerate(tally.examples[:NUM_SURPRISES], 1):
        verdict.note(f"surprise {number}", example)
