"""A plan that nobody wants any more ends soon, whatever it is doing; the others never notice."""
# ruff: noqa: ARG002 - a fake takes what the protocol gives it

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np
import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, ICEM, METHODS, MPPI, ActionDiffusion, DatasetPrior, Uniform
from app.planning.methods.base import LearnedProposal, Method, Optimiser
from app.planning.objectives import Objective
from app.planning.planner import plan, plan_multistep
from app.planning.plant.system import System
from app.planning.prior import ControlPrior
from app.planning.problem import Candidates, Cost, Problem
from app.planning.reachable.reachability import reachability
from app.planning.refining.refinement import Refinement, refine
from app.planning.stop import Stop, Stopped

PROBLEM = Problem(np.zeros(2), np.array([0.5, 0.0]))
LONG = Problem(np.array([0.1, 0.2]), np.array([1e3, 0.5]), horizon=1024)
TIMEOUT_S = 10.0
UNDER_WAY_S = 0.05
TARGETS = [np.array([0.4, 0.0]), np.array([-0.4, 0.0]), np.array([0.2, 0.0])]


class Unwanted(Stopped):
    pass


def stopped(reason: Stopped | None = None) -> Stop:
    stop = Stop()
    stop.set(reason or Unwanted())
    return stop


def test_the_first_reason_stands_and_is_the_one_raised() -> None:
    stop, first = Stop(), Unwanted()
    stop.check()
    assert not stop.flag[0]

    stop.set(first)
    stop.set(Stopped())

    assert stop.flag[0]
    for _ in range(2):
        with pytest.raises(Unwanted) as raised:
            stop.check()
        assert raised.value is first


class NoiseAsControls:
    def sample(
        self, problem: Problem, noise: FloatArray, sampler: str, steps: int, guidance_scale: float
    ) -> Candidates:
        return Candidates(noise)


EVERY_METHOD: list[Method] = [
    ActionDiffusion(),
    DatasetPrior(),
    Uniform(),
    CEM(iterations=5),
    ICEM(iterations=5),
    MPPI(iterations=5),
    Started(CEM(iterations=3), ActionDiffusion()),
]
OPTIMISERS: list[Optimiser] = [CEM(), ICEM(), MPPI()]
by_name = pytest.mark.parametrize(
    "method", EVERY_METHOD, ids=lambda m: "started" if isinstance(m, Started) else m.name
)
by_optimiser = pytest.mark.parametrize("method", OPTIMISERS, ids=lambda method: method.name)
every_objective = pytest.mark.parametrize("objective", get_args(Objective))


def test_every_method_of_the_service_is_tested_here() -> None:
    assert {type(method) for method in EVERY_METHOD} == {*METHODS, Started}


@by_name
@every_objective
def test_a_stop_that_nobody_sets_changes_nothing(method: Method, objective: Objective) -> None:
    def make(**options: Any) -> Any:
        return plan_multistep(
            np.zeros(2),
            TARGETS,
            System(),
            32,
            method,
            6,
            np.random.default_rng(0),
            NoiseAsControls(),
            Refinement(),
            objective,
            **options,
        )

    usual, stoppable = make(), make(stop=Stop())

    np.testing.assert_array_equal(stoppable.controls, usual.controls)
    assert stoppable.cost == usual.cost
    assert stoppable.mean_end_floor == usual.mean_end_floor


@by_name
def test_a_plan_that_is_not_wanted_from_the_start_is_not_begun(method: Method) -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    reason = Unwanted()

    with pytest.raises(Unwanted) as raised:
        plan(PROBLEM, method, 8, rng, NoiseAsControls(), stop=stopped(reason))

    assert raised.value is reason
    assert rng.bit_generator.state == before


@by_optimiser
@pytest.mark.parametrize("started", [False, True], ids=["from nothing", "started"])
def test_an_optimiser_that_is_stopped_before_its_first_iteration_stops(
    method: Optimiser, started: bool
) -> None:
    initial = np.zeros((8, 64)) if started else None

    with pytest.raises(Unwanted):
        method.improve(PROBLEM, 8, np.random.default_rng(0), initial, stopped())


class StopsAtDraw(np.random.Generator):
    """Sets a stop when it is asked for the n-th array of normal numbers."""

    def __init__(self, stop: Stop, draw: int) -> None:
        super().__init__(np.random.PCG64(0))
        self.draws = 0
        self._stop, self._draw = stop, draw

    def standard_normal(self, *args: Any, **options: Any) -> Any:
        self.draws += 1
        if self.draws == self._draw:
            self._stop.set(Unwanted())
        return super().standard_normal(*args, **options)


@pytest.mark.parametrize("method", [ICEM(iterations=1000), MPPI(iterations=1000)])
@pytest.mark.parametrize("draw", [1, 2, 7])
def test_a_stop_ends_the_iterations_at_once(method: Optimiser, draw: int) -> None:
    stop = Stop()
    rng = StopsAtDraw(stop, draw)

    with pytest.raises(Unwanted):
        method.propose(PROBLEM, 8, rng, None, stop)

    assert rng.draws == draw


def assert_stops(work: Callable[[Stop], object], begun: Callable[[], bool]) -> None:
    """Run `work` in a thread, stop it once it has begun, and wait until it raises the reason.

    It takes much longer than the timeout if it does not stop.
    """
    stop, reason = Stop(), Unwanted()
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work(stop)
        except Stopped as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive() and not begun():
        threading.Event().wait(0.001)
    assert thread.is_alive(), "it was done before it could be stopped"
    stop.set(reason)
    thread.join(TIMEOUT_S)
    assert not thread.is_alive(), "it does not stop"
    assert raised == [reason]


@pytest.mark.parametrize("optimiser", [CEM, ICEM, MPPI])
def test_a_stop_from_another_thread_ends_an_optimiser_that_runs(
    optimiser: type[CEM | ICEM | MPPI],
) -> None:
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state

    assert_stops(
        lambda stop: optimiser(iterations=1000).propose(LONG, 2400, rng, None, stop),
        lambda: rng.bit_generator.state != before,
    )


@dataclass
class Proposes:
    """A method that proposes given controls, and does something else beside."""

    controls: FloatArray
    also: Callable[[], object] = lambda: None
    name: str = "proposes"
    problems: list[Problem] = field(default_factory=list)

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = Stop(),  # noqa: B008 - never set
    ) -> Candidates:
        self.problems.append(problem)
        self.also()
        return Candidates(self.controls)

    def cost(self, num_candidates: int) -> Cost:
        return Cost()


@pytest.mark.parametrize("objective", ["control_energy", "control_smoothness"])
def test_a_stop_from_another_thread_ends_a_refinement_that_runs(objective: Objective) -> None:
    problem = Problem(np.array([0.0, 0.5]), np.array([5.0, 0.3]), horizon=1024)
    controls = ControlPrior().sample(2000, 1024, 0.9, np.random.default_rng(0))
    proposed = threading.Event()

    assert_stops(
        lambda stop: plan(
            problem,
            Proposes(controls, proposed.set),
            len(controls),
            np.random.default_rng(0),
            refinement=Refinement(iterations=1000),
            objective=objective,
            stop=stop,
        ),
        lambda: proposed.is_set() and not threading.Event().wait(UNDER_WAY_S),
    )


@every_objective
@pytest.mark.parametrize("repair", [False, True])
def test_a_refinement_that_is_not_wanted_raises(objective: Objective, repair: bool) -> None:
    controls = ControlPrior().sample(8, 64, 0.9, np.random.default_rng(0))

    with pytest.raises(Unwanted):
        refine(PROBLEM, controls, Refinement(repair=repair), objective, stopped())


def test_a_floor_that_nobody_wants_is_not_computed() -> None:
    with pytest.raises(Unwanted):
        reachability(LONG, stopped())


def test_a_plan_is_stopped_after_its_proposal_too() -> None:
    stop = Stop()

    with pytest.raises(Unwanted):
        plan(
            PROBLEM,
            Proposes(np.zeros((4, 64)), lambda: stop.set(Unwanted())),
            4,
            np.random.default_rng(0),
            stop=stop,
        )


def test_a_multistep_plan_is_stopped_between_its_targets() -> None:
    stop = Stop()

    def second_time() -> None:
        if len(method.problems) == 2:
            stop.set(Unwanted())

    method = Proposes(np.zeros((4, 32)), second_time)

    with pytest.raises(Unwanted):
        plan_multistep(
            np.zeros(2), TARGETS, System(), 32, method, 4, np.random.default_rng(0), stop=stop
        )

    assert len(method.problems) == 2


def test_a_stop_in_the_initial_method_keeps_the_optimiser_from_running() -> None:
    stop = Stop()
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    initial = Proposes(np.zeros((4, 64)), lambda: stop.set(Unwanted()))

    with pytest.raises(Unwanted):
        plan(PROBLEM, Started(CEM(), initial), 4, rng, stop=stop)

    assert rng.bit_generator.state == before
