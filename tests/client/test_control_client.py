"""Clients of sessions: the examples shown, what is refused, and how another session goes on."""

import asyncio
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

import app.client
from app.client import (
    AsyncControlClient,
    ControlClient,
    ControlRequest,
    PlannerClient,
    RequestRefused,
    SessionEnded,
    SimulateRequest,
    Start,
)
from app.launch import START_SECONDS, ServerProcess, launch
from app.planning.control import RecedingHorizon
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.uncertainty.relative import Relative
from app.settings import Settings
from app.wire.uncertainty import Ensemble
from tests.served import serving, wait_until_ready

README = Path(app.client.__file__).with_name("README.md").read_text()
EXAMPLE, ELSEWHERE = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
KEY = "a-key-that-is-long-enough"
TRUTH = System(0.78, 0.66)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with serving(Settings(model_store=tmp_path_factory.mktemp("empty"), api_keys=KEY)) as client:
        wait_until_ready(client)
        yield client


@pytest.fixture(scope="module")
def url(client: httpx.Client) -> str:
    return str(client.base_url)


class Machine:
    """Simulated, with more friction than is believed."""

    def __init__(self) -> None:
        self.state = [0.0, 0.0]
        self.controls: list[float] = []

    def measure(self) -> tuple[float, float]:
        return self.state[0], self.state[1]

    def send(self, control: float) -> None:
        self.controls.append(control)
        sent = [[control]]
        self.state = rollout(TRUTH, self.state, sent)[0, -1].tolist()  # type: ignore[arg-type]


def test_the_example_shown_arrives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = EXAMPLE.partition("machine, state")[2].splitlines()
    assert len([line for line in shown if line.strip()]) <= 20
    with serving(Settings(model_store=tmp_path)) as open_to_all:
        wait_until_ready(open_to_all)
        names: dict[str, list[float]] = {}
        exec(EXAMPLE.replace("http://127.0.0.1:8000", str(open_to_all.base_url)), names)
    assert names["state"] == pytest.approx([-0.1, 0.0], abs=1e-3)
    assert capsys.readouterr().out.startswith("arrived")


def test_single_steps_and_runs(url: str) -> None:
    with ControlClient(url, KEY) as client:
        step = client.step(ControlRequest(state=(0.0, 0.0), target_state=(0.2, 0.0)))
        again = client.step(
            ControlRequest(position=0.01, target_state=(0.2, 0.0), carry=step.carry)
        )
        assert again.control > 0
        assert again.estimate.position == pytest.approx(0.01, abs=1e-3)
    with PlannerClient(url, api_key=KEY) as planner:
        answer = planner.simulate(
            SimulateRequest(
                initial_state=(0, 0),
                controller=RecedingHorizon(),
                target_state=(0.1, 0),
                num_runs=3,
                seed=1,
            )
        )
        assert [run.seed for run in answer.runs] == [1, 2, 3]
        assert all(run.status == "arrived" for run in answer.runs)


def test_what_is_refused_says_why(url: str) -> None:
    start = Start(target_state=(0.2, 0.0))
    strange = ControlClient(url)
    with strange, pytest.raises(RequestRefused) as refused, strange.session(start):
        pass
    assert refused.value.problem.status == 401
    beyond = Start(target_state=(0.2, 0.0), pending_controls=[5.0])
    with ControlClient(url, KEY) as client:
        with pytest.raises(RequestRefused) as refused, client.session(beyond):
            pass
        assert refused.value.problem.errors
        assert refused.value.problem.errors[0].pointer == "/pending_controls/0"


def test_several_sessions_at_once_by_one_asynchronous_client(url: str) -> None:
    async def drive(client: AsyncControlClient, target: float) -> float:
        machine = Machine()
        async with client.session(Start(target_state=(0.0, 0.0))) as session:
            await session.target(target)
            for _ in range(80):
                machine.send((await session.measure(*machine.measure())).control)
            assert (await session.stop()).step == 80
        return machine.state[0]

    async def drive_all(targets: list[float]) -> list[float]:
        async with AsyncControlClient(url, KEY) as client:
            request = ControlRequest(state=(0.0, 0.0), target_state=(0.2, 0.0))
            assert (await client.step(request)).control > 0
            return await asyncio.gather(*(drive(client, target) for target in targets))

    targets = [-0.2, 0.1, 0.3]
    assert asyncio.run(drive_all(targets)) == pytest.approx(targets, abs=1e-3)


@pytest.fixture
def ending(tmp_path: Path) -> Iterator[ServerProcess]:
    """A service that is there to end."""
    with launch("app", "serve", "--model-store", str(tmp_path)) as server:
        yield server


@pytest.mark.parametrize(
    ("sent", "reason"),
    [(signal.SIGTERM, "draining"), (signal.SIGKILL, "connection lost")],
)
def test_a_session_goes_on_with_another_service(
    ending: ServerProcess, url: str, sent: signal.Signals, reason: str
) -> None:
    undisturbed, machine = Machine(), Machine()
    uncertainty = Ensemble(relative=Relative(coulomb_friction=0.1), num_systems=4)
    start = Start(
        target_state=(0.2, 0.0), steps_left=40, uncertainty=uncertainty, include=["carry"]
    )
    with ControlClient(ending.url) as client, client.session(start) as session:
        for _ in range(15):
            machine.send(session.measure(*machine.measure()).control)
        ending.process.send_signal(sent)
        # Sessions do not keep a service that drains from its end.
        assert ending.process.wait(START_SECONDS) == -sent
        with pytest.raises(SessionEnded) as ended:
            session.measure(*machine.measure())
    assert ended.value.reason == reason
    resume = ended.value.resume
    with ControlClient(url, KEY) as client, client.session(resume) as session:
        for _ in range(45):
            machine.send(session.measure(*machine.measure()).control)

    # The plants that the first service drew are planned for in the other, too.
    whole = start.model_copy(update={"seed": resume.seed})
    with ControlClient(url, KEY) as client, client.session(whole) as session:
        for _ in range(60):
            undisturbed.send(session.measure(*undisturbed.measure()).control)
    assert machine.controls == undisturbed.controls


def test_the_road_from_one_service_to_another_that_is_shown(tmp_path: Path) -> None:
    names: dict[str, object] = {}
    exec(ELSEWHERE, names)
    drive = names["drive"]
    assert callable(drive)
    machine = Machine()
    with ExitStack() as first, serving(Settings(model_store=tmp_path)) as second:
        here = first.enter_context(serving(Settings(model_store=tmp_path)))
        for client in (here, second):
            wait_until_ready(client)

        def send(control: float) -> None:
            machine.send(control)
            if len(machine.controls) == 10:
                first.close()
            if len(machine.controls) == 80:
                raise InterruptedError

        urls = [str(here.base_url), str(second.base_url)]
        with pytest.raises(InterruptedError):
            drive(urls, Start(target_state=(0.2, 0.0)), machine.measure, send)
    assert machine.state == pytest.approx([0.2, 0.0], abs=1e-3)
