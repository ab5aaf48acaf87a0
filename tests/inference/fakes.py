"""Networks that fail on demand, models around them, and what a sampling gives alone."""

import threading
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from app.inference.conditioning import Conditioning
from app.inference.device import CPU
from app.inference.engine import Engine
from app.inference.job import Job
from app.inference.manifest import Losses, Manifest
from app.inference.model import Model
from app.inference.model_card import Pace
from app.inference.networks.base import Network
from app.inference.noise_levels import noise_levels
from app.inference.sampling import Sampling, sample_alone
from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion
from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS, Sampler, Solver
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import System
from app.planning.problem import Problem
from training.schedule import cosine_alphas_cumprod

HORIZON = 8
TIMESTEPS = 40
ROWS_AT_ONCE = 16
TIMEOUT_S = 300.0
RAISES, NOT_A_NUMBER = 100.0, 200.0
"""Target velocities with which `FakeNetwork` fails, in the second half of the diffusion times."""


class FakeNetwork:
    """Predicts each row by exact arithmetic on that row, so beside any others the same to the bit.

    Args:
        slope: networks with different ones predict differently.
    """

    def __init__(self, slope: float = 0.3) -> None:
        self._slope = slope
        self.embedded: list[Tensor] = []
        self.batches: list[tuple[Tensor, Tensor, Tensor]] = []
        """The arguments of every call of `predict`."""

    def embed(self, condition: Tensor) -> Tensor:
        self.embedded.append(condition)
        start, _, target, failure = condition.tolist()
        return torch.tensor([[0.5 * start - target, failure], [0.7, failure]])

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        self.batches.append((u_t.clone(), t.clone(), embedding.clone()))
        offset, failure = embedding[:, :1], torch.where(t < TIMESTEPS // 2, embedding[:, 1], 0)
        if (failure == RAISES).any():
            raise ArithmeticError("on demand")
        noise = u_t * self._slope + offset * (t.unsqueeze(1) / TIMESTEPS)
        noise[failure == NOT_A_NUMBER] = torch.nan
        return noise.clamp(-3, 3)


class Stepped:
    """A network that answers only as often as it is let."""

    def __init__(self, network: Network, answers: int = 0) -> None:
        self.embed = network.embed
        self.network = network
        self._changed = threading.Condition()
        self._asked, self._answers = 0, answers
        self.times_at_once = 0
        """The most diffusion times that a batch had."""

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        self.times_at_once = max(self.times_at_once, len(set(t.tolist())))
        with self._changed:
            self._asked += 1
            self._changed.notify_all()
            assert self._changed.wait_for(lambda: self._asked <= self._answers, TIMEOUT_S)
        return self.network.predict(u_t, t, embedding)

    @property
    def waits(self) -> bool:
        """Whether a batch waits for its answer."""
        with self._changed:
            return self._asked > self._answers

    def wait_until_asked(self, times: int) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: self._asked >= times, TIMEOUT_S)

    def let(self, answers: int) -> None:
        """Let it give so many answers more."""
        with self._changed:
            self._answers += answers
            self._changed.notify_all()

    def let_all(self) -> None:
        self.let(10**9)


def fake_model(
    network: Network, name: str = "fake", rows_at_once: int = ROWS_AT_ONCE, **fields: Any
) -> Model:
    manifest = Manifest(
        **{
            "name": name,
            "version": 1,
            "sha256": "0" * 64,
            "coverage": Coverage.only(System()),
            "system": System(),
            "horizon": HORIZON,
            "condition": Conditioning.on_states((0.0, 0.0), (1.0, 1.0)),
            "predicts": "noise",
            "samplers": PAPER_MODEL_SAMPLERS,
            "trained_on": "Nothing.",
            "alphas_cumprod": tuple(cosine_alphas_cumprod(TIMESTEPS).tolist()),
            "training": {},
            "seeds": {},
            "losses": Losses(training=0.1, validation=0.2),
            "libraries": {},
            **fields,
        }
    )
    levels = noise_levels(manifest.kind, manifest.alphas_cumprod)
    return Model(manifest, Pace(rows_at_once, 1e-6), network, 0, CPU, levels)


class Asked(NamedTuple):
    """What a request asks of a model."""

    num_candidates: int = 4
    steps: int = 3
    solver: Solver = "ddim"
    guidance_scale: float = 2.0
    failure: float = 0.0
    """`RAISES`, `NOT_A_NUMBER` or nothing: the target's velocity."""
    seed: int = 0
    horizon: int = HORIZON

    @property
    def problem(self) -> Problem:
        start, target = np.random.default_rng(self.seed).uniform(-0.5, 0.5, 2)
        return Problem(
            np.array([start, 0.0]), np.array([target, self.failure]), System(), self.horizon
        )

    @property
    def noise(self) -> FloatArray:
        rng = np.random.default_rng(self.seed)
        return rng.standard_normal((self.num_candidates, self.horizon))

    @property
    def sampler(self) -> Sampler:
        """With the times of the paper's models."""
        options = ActionDiffusion(
            sampler=self.solver, steps=self.steps, guidance_scale=self.guidance_scale
        )
        return options.settled(PAPER_MODEL_SAMPLERS)

    @property
    def rows(self) -> int:
        """That go through the network, in all steps."""
        return self.num_candidates * self.sampler.cost(self.num_candidates).network_evaluations

    def sampling(self, model: Model, job: Job | None = None) -> Sampling:
        return Sampling(
            job or Job(self.rows),
            model,
            self.problem,
            self.noise,
            self.sampler,
        )

    def alone(self, model: Model) -> FloatArray:
        """Return the controls without any engine; raises what the network or the sampling does."""
        return sample_alone(model, self.problem, self.noise, self.sampler)


def many(
    count: int,
    seed: int,
    horizon: int = HORIZON,
    most: int = 40,
    guidance_scales: Sequence[float] = (0.0, 0.5, 1.0, 2.0, 7.5),
) -> list[Asked]:
    """Return requests of all kinds."""
    rng = np.random.default_rng(seed)
    return [
        Asked(
            num_candidates=int(rng.integers(1, most)),
            steps=int(rng.integers(1, 9)),
            solver=("ddim", "dpm_solver")[rng.integers(2)],
            guidance_scale=float(rng.choice(guidance_scales)),
            seed=index,
            horizon=horizon,
        )
        for index in range(count)
    ]


@dataclass
class Request:
    """What was asked of an engine, and what became of it."""

    asked: Asked
    job: Job
    done: Future[tuple[FloatArray, float]]

    @property
    def controls(self) -> FloatArray:
        """Wait for them; raises what went wrong instead."""
        return self.done.result(TIMEOUT_S)[0]


def submit(engine: Engine, model: Model, asked: Asked) -> Request:
    job = Job(asked.rows)
    return Request(asked, job, engine.submit(job, lambda: asked.sampling(model, job)))
