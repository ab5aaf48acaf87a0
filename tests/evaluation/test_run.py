"""Whatever ends an evaluation or the service meanwhile: it goes on, to the same report."""

import asyncio
import lzma
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from app.client.planner_client import AsyncPlannerClient
from app.evaluation.answer_log import AnswerLog, EvaluationError
from app.evaluation.entrants import DIFFUSION, UNIFORM
from app.evaluation.question import Question
from app.evaluation.run import evaluate
from app.evaluation.suite import Parts, Size, Suite, Table
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.suites.multistep_reference import MultistepReference
from app.evaluation.tasks import sequence_tasks
from app.launch import START_SECONDS, free_port
from app.main import create_app
from app.planning.plant.system import System
from app.settings import Settings
from tests.served import running

SMALL_QUESTIONS = 12


class Recorder:
    """A service that remembers what it was asked.

    Args:
        model_store: of the service.
        delay_s: how long it lets everyone wait.
    """

    def __init__(self, model_store: Path, delay_s: float = 0.0) -> None:
        self.asked: list[bytes] = []
        self._model_store = model_store
        self._delay_s = delay_s

    @contextmanager
    def running(self, port: int = 0) -> Iterator[str]:
        app = create_app(Settings(model_store=self._model_store))

        async def listen(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["type"] != "http" or scope["path"] != "/plan_multistep":
                await app(scope, receive, send)
                return
            body = await Request(scope, receive).body()
            self.asked.append(body)
            await asyncio.sleep(self._delay_s)
            again = iter([body])

            async def repeat() -> Message:
                for once in again:
                    return {"type": "http.request", "body": once, "more_body": False}
                return await receive()

            await app(scope, repeat, send)

        with running(listen, port) as url:
            yield url

    def wait_for(self, number: int, ended: Callable[[], object]) -> None:
        """Return when it was asked so many different questions, or the asking has ended."""
        while len(set(self.asked)) < number and not ended():
            time.sleep(0.002)


@dataclass(frozen=True)
class Small(Suite):
    """Two methods on a few sequences."""

    name = "small"
    title = "Small"
    draw_tasks = staticmethod(sequence_tasks)
    FULL = Size(budgets=(4,), tasks=3, runs=2, entrants=(UNIFORM, DIFFUSION))
    system: System | None = None
    if_covered: bool = False

    def questions(self) -> Iterator[Question]:
        for entrant in self.size.entrants:
            asked = entrant.asking(system=self.system)
            yield from self.ask(asked, 4, if_covered=self.if_covered)

    def report(self, data: pd.DataFrame) -> Parts:
        yield "A few."
        yield Table("Errors.", ("Final error",), [(str(error),) for error in data.final_error])


def run(suite: Suite, url: str, out: Path, patience_s: float = START_SECONDS) -> Path:
    client = AsyncPlannerClient(url, patience_s)
    return asyncio.run(evaluate([suite], lambda: client, out, 1, Console(quiet=True)))


def assert_same_report(one: Path, other: Path) -> None:
    """All but the times is equal: tables and figures byte for byte."""
    files = {file.relative_to(one) for file in one.rglob("*") if file.is_file()}
    assert files == {file.relative_to(other) for file in other.rglob("*") if file.is_file()}
    for file in files:
        if file.suffix == ".csv":
            pd.testing.assert_frame_equal(without_times(one / file), without_times(other / file))
        elif file.suffix in {".tex", ".pdf", ".png"} and not file.stem.endswith("-time"):
            assert (one / file).read_bytes() == (other / file).read_bytes(), file


def without_times(file: Path) -> pd.DataFrame:
    return pd.read_csv(file).drop(columns=["compute_ms", "latency_ms"])


def evaluate_with_kills(
    name: str, service: Recorder, out: Path, moments: list[tuple[int, float]]
) -> int:
    """Kill an evaluation at `moments`, let it go on to its end, and return how often it died.

    Args:
        name: of the suite.
        service: that it asks.
        out: the evaluation's folder.
        moments: after so many questions, and so many seconds more.
    """
    kills = 0
    with service.running() as url:
        arguments = ("evaluate", name, "--quick", "--url", url, "--out", str(out))
        command = [sys.executable, "-m", "app", *arguments]
        for number, after_s in moments:
            with subprocess.Popen(command) as process:
                service.wait_for(number, ended=process.poll)
                time.sleep(after_s)
                process.kill()
            kills += process.returncode == -signal.SIGKILL
        subprocess.run(command, check=True)
    return kills


@pytest.mark.parametrize(
    ("suite", "seed", "num_kills"),
    [
        (MultistepReference, 0, 1),
        *(pytest.param(MultistepRandom, seed, 12, marks=pytest.mark.slow) for seed in (1, 2)),
    ],
)
def test_killed_at_any_moment_it_goes_on_and_ends_the_same(
    paper_store: Path, tmp_path: Path, suite: type[Suite], seed: int, num_kills: int
) -> None:
    rng = random.Random(seed)
    whole, killed = Recorder(paper_store), Recorder(paper_store)
    with whole.running() as url:
        run(suite(seed=0, quick=True), url, tmp_path / "whole")
    number = len(whole.asked)
    moments = [
        *(
            (after, rng.uniform(0, 0.05))
            for after in sorted(rng.sample(range(1, number), num_kills))
        ),
        (number, rng.uniform(0.05, 0.4)),  # while it writes the report
    ]
    assert evaluate_with_kills(suite.name, killed, tmp_path / "killed", moments) == len(moments)
    assert set(killed.asked) == set(whole.asked)
    assert len(killed.asked) <= number + len(moments)
    assert_same_report(tmp_path / "whole", tmp_path / "killed")


@pytest.fixture(scope="module")
def small(model_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a complete small evaluation."""
    out, service = tmp_path_factory.mktemp("small"), Recorder(model_store)
    with service.running() as url:
        run(Small(seed=0), url, out)
    assert len(service.asked) == len(set(service.asked)) == SMALL_QUESTIONS
    return out


def test_a_service_that_restarts_meanwhile_costs_nothing(
    model_store: Path, small: Path, tmp_path: Path
) -> None:
    port, service = free_port(), Recorder(model_store, delay_s=0.2)
    with ThreadPoolExecutor(1) as pool:
        with service.running(port) as url:
            evaluation = pool.submit(run, Small(seed=0), url, tmp_path)
            service.wait_for(4, ended=evaluation.done)
        assert not evaluation.done()
        with service.running(port):
            evaluation.result()
    assert len(set(service.asked)) == SMALL_QUESTIONS
    assert len(service.asked) <= SMALL_QUESTIONS + 1
    assert_same_report(small, tmp_path)


def test_a_complete_folder_needs_no_service(small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path, dirs_exist_ok=True)
    (tmp_path / "report.md").unlink()
    nowhere = f"http://127.0.0.1:{free_port()}"
    assert run(Small(seed=0), nowhere, tmp_path, patience_s=0.1) == tmp_path / "report.md"
    for file in ("report.md", "report.html", "data/small.csv", "answers.jsonl.xz"):
        assert (small / file).read_bytes() == (tmp_path / file).read_bytes()


def test_only_what_is_missing_is_asked(model_store: Path, small: Path, tmp_path: Path) -> None:
    shutil.copytree(small, tmp_path, dirs_exist_ok=True)
    service = Recorder(model_store)
    with service.running() as url:
        run(Small(seed=1), url, tmp_path)
    assert len(service.asked) == SMALL_QUESTIONS
    run(Small(seed=0), "http://nowhere", tmp_path)
    assert_same_report(small, tmp_path)


def test_what_another_model_answered_is_asked_again(
    model_store: Path, small: Path, tmp_path: Path
) -> None:
    answers = lzma.decompress((small / "answers.jsonl.xz").read_bytes()).decode()
    of_another = answers.replace('"model": {"name": "', '"model": {"name": "older-')
    # One answer is missing: a complete folder needs no service, and asks none.
    all_but_one = of_another.splitlines(keepends=True)[:-1]
    (tmp_path / "answers.jsonl").write_text("".join(all_but_one))
    service = Recorder(model_store)
    with service.running() as url:
        run(Small(seed=0), url, tmp_path)
    assert of_another != answers
    assert len(service.asked) == len(set(service.asked)) == SMALL_QUESTIONS / 2
    assert all(b"action_diffusion" in body for body in service.asked)
    assert_same_report(small, tmp_path)


def test_a_plant_without_a_model_is_refused_before_anything_is_asked(
    model_store: Path, tmp_path: Path
) -> None:
    suite, service = Small(seed=0, system=System(static_friction=0.65)), Recorder(model_store)
    with (
        service.running() as url,
        pytest.raises(EvaluationError, match=r"no model .*static_friction=0.65"),
    ):
        run(suite, url, tmp_path)
    assert not service.asked
    with AnswerLog(tmp_path) as log:
        assert not log.sessions


def test_what_no_model_covers_is_left_out_where_a_suite_says_so_and_not_looked_for_again(
    model_store: Path, tmp_path: Path
) -> None:
    suite = Small(seed=0, system=System(static_friction=0.65), if_covered=True)
    service = Recorder(model_store)
    with service.running() as url:
        run(suite, url, tmp_path)

    assert len(service.asked) == SMALL_QUESTIONS / 2
    data = pd.read_csv(tmp_path / "data/small.csv")
    assert set(data.entrant) == {UNIFORM.label}
    run(suite, "http://nowhere", tmp_path)
