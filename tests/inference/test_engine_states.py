"""Requests that come, overlap, are stopped and fail in any order: each ends once and rightly."""

from dataclasses import dataclass, replace
from time import perf_counter, sleep

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from app.inference.engine import Engine
from app.inference.model import Model
from app.inference.solvers import SOLVERS
from app.planning.methods.sampler import Solver
from app.planning.problem import PlanningError
from app.planning.stop import Stopped
from tests.inference.fakes import (
    NOT_A_NUMBER,
    RAISES,
    TIMEOUT_S,
    Asked,
    FakeNetwork,
    Request,
    Stepped,
    fake_model,
    submit,
)

MODELS = 2


class Cancelled(Stopped):
    pass


class Expired(Stopped):
    pass


@dataclass(eq=False)
class Known:
    """A request, and what is known of how it may end."""

    request: Request
    slope: float
    """Of its model's network."""
    stopped: Stopped | None = None
    checked: bool = False

    @property
    def is_done(self) -> bool:
        return self.request.done.done()

    def check(self) -> None:
        """Compare how it ended with how it ends alone, or was stopped."""
        self.checked = True
        error = self.request.done.exception(timeout=0)
        if isinstance(error, Stopped):
            assert error is self.stopped
            return
        asked, model = self.request.asked, fake_model(FakeNetwork(self.slope))
        try:
            expected = asked.alone(model)
        except (ArithmeticError, PlanningError):
            assert isinstance(error, PlanningError)
        else:
            assert error is None
            np.testing.assert_array_equal(self.request.controls, expected)
            assert self.request.job.rows_left == 0


class Requests(RuleBasedStateMachine):
    """An engine whose networks answer batch by batch, as often as they are let, or freely."""

    def __init__(self) -> None:
        super().__init__()
        self.engine = Engine(num_threads=1)
        self.is_free = False
        """Whether the networks answer at once, and everything races."""
        self.known: list[Known] = []
        self.networks: list[Stepped] = []
        self.served: list[tuple[Model, float]] = []

    def publish(self, slope: float) -> tuple[Model, float]:
        model = fake_model(FakeNetwork(slope))
        network = Stepped(model.network)
        if self.is_free:
            network.let_all()
        self.networks.append(network)
        return replace(model, network=network), slope

    def settle(self) -> None:
        """Wait until the engine does: for an answer of a network, or for requests."""
        deadline = perf_counter() + TIMEOUT_S
        while not self.is_free and not all(known.is_done for known in self.known):
            if any(network.waits for network in self.networks):
                return
            assert perf_counter() < deadline, "a request is lost"
            sleep(0.0002)

    @property
    def wanted(self) -> list[Known]:
        """Those that nobody stopped; some may have ended, which the draws must not depend on."""
        return [known for known in self.known if not known.stopped]

    @initialize(is_free=st.booleans())
    def start(self, is_free: bool) -> None:
        self.is_free = is_free
        self.served = [self.publish(0.3 + 0.1 * index) for index in range(MODELS)]

    @rule(
        index=st.integers(0, MODELS - 1),
        num_candidates=st.integers(1, 30),
        steps=st.integers(1, 5),
        solver=st.sampled_from(list(SOLVERS)),
        guidance_scale=st.sampled_from([0.0, 0.5, 1.0, 2.0]),
        failure=st.sampled_from([0.0, 0.0, 0.0, RAISES, NOT_A_NUMBER]),
        seed=st.integers(0, 9),
    )
    def ask(
        self,
        index: int,
        num_candidates: int,
        steps: int,
        solver: Solver,
        guidance_scale: float,
        failure: float,
        seed: int,
    ) -> None:
        model, slope = self.served[index]
        asked = Asked(num_candidates, steps, solver, guidance_scale, failure, seed)
        self.known.append(Known(submit(self.engine, model, asked), slope))
        self.settle()

    @precondition(lambda self: self.wanted)
    @rule(data=st.data(), reason=st.sampled_from([Cancelled, Expired]))
    def stop(self, data: st.DataObject, reason: type[Stopped]) -> None:
        known = data.draw(st.sampled_from(self.wanted))
        known.stopped = reason()
        known.request.job.stop.set(known.stopped)

    @rule(answers=st.integers(1, 8))
    def let(self, answers: int) -> None:
        for _ in range(answers):
            for network in self.networks:
                if network.waits:
                    network.let(1)
            self.settle()

    @rule(index=st.integers(0, MODELS - 1), slope=st.floats(-0.5, 0.5))
    def reload(self, index: int, slope: float) -> None:
        self.served[index] = self.publish(slope)

    @invariant()
    def what_has_ended_has_ended_rightly(self) -> None:
        for known in self.known:
            if known.is_done and not known.checked:
                known.check()

    def teardown(self) -> None:
        for network in self.networks:
            network.let_all()
        self.engine.close()
        for known in self.known:
            assert known.is_done
            known.check()
            if known.stopped is None:
                assert not isinstance(known.request.done.exception(), Stopped)


Requests.TestCase.settings = settings(max_examples=80, stateful_step_count=30, deadline=None)
TestRequests = Requests.TestCase
