"""Sessions without a connection: who is let in, where long steps are computed, and their end."""

import asyncio
import threading
from time import perf_counter
from typing import Any

import pytest

from app.planning.control import PD, RecedingHorizon
from app.planning.control.step import control_step
from app.planning.plant.system import System
from app.serving import control_session
from app.serving.control_sessions import MOST_LOAD, ControlSessions
from app.serving.refusals import Refused
from app.serving.step_threads import StepThreads
from app.settings import Settings
from app.wire.sessions import Measure, Start, Stop, Target

START = Start(target_state=(0.2, 0.0), steps_left=40)
LONG = Start(target_state=(0.2, 0.0), controller=RecedingHorizon(iterations=100))


def sessions(**settings: Any) -> ControlSessions:
    return ControlSessions(Settings(**settings), lambda: StepThreads(num_threads=1).compute)


def converse(all_of_them: ControlSessions, *messages: Any) -> list[dict[str, Any]]:
    async def answer() -> list[dict[str, Any]]:
        with all_of_them.opened(lambda: None) as session:
            return [await session.answer(message, perf_counter()) for message in messages]

    return asyncio.run(answer())


def test_a_session_is_closed_with_its_context_whatever_happens() -> None:
    some = sessions(max_sessions=1)

    def fail() -> None:
        with some.opened(lambda: None):
            assert len(some) == 1
            with pytest.raises(Refused), some.opened(lambda: None):
                pass
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert len(some) == 0


@pytest.mark.parametrize(("start", "is_apart"), [(START, False), (LONG, True)])
def test_only_steps_that_take_long_go_to_a_thread(
    start: Start, is_apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = []

    def noted(*args: Any, **kwargs: Any) -> Any:
        threads.append(threading.current_thread())
        return control_step(*args, **kwargs)

    monkeypatch.setattr(control_session, "control_step", noted)
    converse(sessions(), start, Measure(position=0.0, velocity=0.0))
    assert [thread is not threading.main_thread() for thread in threads] == [is_apart]


def test_loops_are_let_in_until_they_would_keep_each_other_waiting() -> None:
    async def start_many(time_step: float) -> int:
        some, admitted = sessions(max_sessions=100), 0
        contexts = [some.opened(lambda: None) for _ in range(100)]
        asked = Start(target_state=(0.2, 0.0), system=System(time_step=time_step), controller=PD())
        for context in contexts:
            session = context.__enter__()
            try:
                await session.answer(asked, perf_counter())
            except Refused:
                assert session.loop is None
                continue
            admitted += 1
        return admitted

    fast, slow = (asyncio.run(start_many(time_step)) for time_step in (0.005, 0.05))
    assert 0 < fast < slow <= 100
    assert fast <= MOST_LOAD * 0.005 / control_session.MESSAGE_SECONDS


def test_what_another_session_goes_on_with_is_counted_along() -> None:
    start = START.model_copy(update={"pending_controls": [0.1, -0.2]})
    measure = Measure(position=0.0, velocity=0.0)
    *_, control, ended = converse(sessions(), start, measure, Stop())
    assert ended["pending_controls"] == (-0.2, control["control"])
    assert ended["steps_left"] == 39
    aimed = Target(target_state=(-0.1, 0.0), steps_left=0)
    *_, ended = converse(sessions(), start, aimed, measure, Stop())
    assert (ended["target_state"], ended["steps_left"]) == ((-0.1, 0.0), 0)


def test_draining_wakes_all_and_waits_for_their_end() -> None:
    some = sessions()

    async def be_in_session(woken: asyncio.Event) -> None:
        with some.opened(woken.set):
            await woken.wait()

    async def drain() -> None:
        async with asyncio.TaskGroup() as tasks:
            for _ in range(3):
                tasks.create_task(be_in_session(asyncio.Event()))
            await asyncio.sleep(0)
            assert len(some) == 3
            await some.drain()
            assert len(some) == 0

    asyncio.run(drain())
