"""Questions, answers and a service, all made up."""

from datetime import UTC, datetime
from typing import Any

from app.evaluation.answer_log import Session
from app.evaluation.question import Question
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import System
from app.wire.about import ModelDescription
from app.wire.answers import (
    CostReport,
    ModelReference,
    PlanResponse,
    ReachabilityReport,
    TimingReport,
)
from app.wire.requests import PlanRequest

SHA256 = "a" * 64


def question(seed: int, method: str = "uniform", *, trajectories: bool = False) -> Question:
    request = {
        "initial_state": (0.0, 0.0),
        "target_state": (0.2, 0.0),
        "method": method,
        "seed": seed,
    }
    return Question({"task": seed}, PlanRequest.model_validate(request), trajectories)


def model_description(name: str = "tiny", **fields: Any) -> ModelDescription:
    """A model of the paper's plant."""
    return ModelDescription(
        **{
            "name": name,
            "version": "1",
            "sha256": SHA256,
            "trained_on": "Nothing.",
            "plants": "The paper's.",
            "coverage": Coverage.only(System()),
            "system": System(),
            "horizon": 64,
            "predicts": "noise",
            "samplers": PAPER_MODEL_SAMPLERS,
            "diffusion_timesteps": 200,
            "validation_loss": 0.1,
            **fields,
        }
    )


def answer_to(request: PlanRequest, model_sha256: str = SHA256) -> PlanResponse:
    learned = request.method.name == "action_diffusion"
    return PlanResponse(
        method=request.method.name,
        model=ModelReference(name="tiny", version="1", sha256=model_sha256) if learned else None,
        seed=request.seed or 0,
        system=System(),
        controls=[0.5, -0.5],
        states=[(0.0, 0.0), (0.1, 0.1), (0.2, 0.0)],
        terminal_error=0.25,
        gap=0.125,
        reachability=ReachabilityReport(reachable=False, floor=0.125, nearest_state=(0.1, 0.0)),
        control_energy=0.5,
        control_smoothness=1.0,
        stuck_steps=3,
        diversity=0.5,
        cost=CostReport(network_evaluations=0, rollouts=16),
        timing_ms=TimingReport(queue=0.5, propose=1.0, refine=0.0, rollout=1.0, total=2.5),
    )


def session(version: str = "1.2.3", model_sha256: str = SHA256, concurrency: int = 1) -> Session:
    return Session(
        began=datetime(2026, 1, 2, 3, 4, tzinfo=UTC),
        version=version,
        machine="a machine",
        device="cpu",
        network_threads=2,
        libraries={"python": "3.11"},
        models={"tiny/1": model_sha256},
        concurrency=concurrency,
    )
