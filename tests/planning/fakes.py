"""Methods to plan with: every one of the service, quick, and some that are told what to propose."""
# ruff: noqa: ARG002 - a fake takes what the protocol gives it

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from app.launch import START_SECONDS
from app.planning.arrays import FloatArray
from app.planning.methods import METHODS, ActionDiffusion, AnyMethod, Learned
from app.planning.methods.base import Finish, Method
from app.planning.methods.optimiser import Optimiser
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop, Stopped


class NoiseAsControls:
    """A learned proposal that needs no network: the noise is the plan, often beyond the limit."""

    def begin(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Finish:
        return lambda: Candidates(noise, queue_ms=2.5)


LEARNED = Learned(ActionDiffusion().settled(PAPER_MODEL_SAMPLERS), NoiseAsControls())


def quick(kind: type[AnyMethod]) -> Method:
    """Return a method of a kind that can propose: few iterations, and a model if it needs one."""
    if issubclass(kind, ActionDiffusion):
        return LEARNED
    return kind(iterations=3) if issubclass(kind, Optimiser) else kind()


EVERY_METHOD = [quick(kind) for kind in METHODS]
every_method = pytest.mark.parametrize("method", EVERY_METHOD, ids=lambda method: method.name)


@dataclass
class Fixed:
    """A method that proposes given controls, and does something else beside."""

    controls: FloatArray
    also: Callable[[], object] = lambda: None
    name: str = "fixed"
    problems: list[Problem] = field(default_factory=list)

    def propose(
        self, problem: Problem, num_candidates: int, rng: np.random.Generator, stop: Stop = NEVER
    ) -> Candidates:
        self.problems.append(problem)
        self.also()
        return Candidates(self.controls, queue_ms=2.5)

    def cost(self, num_candidates: int) -> Cost:
        return Cost(network_evaluations=3, rollouts=10 * num_candidates)


class Unwanted(Stopped):
    """Why a test stops a plan."""


def stopped(reason: Stopped | None = None) -> Stop:
    """Return a stop that is set."""
    stop = Stop()
    stop.set(reason or Unwanted())
    return stop


def assert_stops(work: Callable[[Stop], object], begun: Callable[[], bool]) -> None:
    """Run `work` in a thread, stop it once it has begun, and wait until it raises the reason.

    It takes minutes if it does not stop, and raises nothing.
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
    thread.join(START_SECONDS)
    assert raised == [reason]
