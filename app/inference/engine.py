"""The engine: one thread that owns the network and its device, one sampling at a time."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter
from typing import ParamSpec, TypeVar

import numpy as np
import torch

from app.inference.model_store import Model
from app.inference.samplers import SAMPLERS, guided, sampling_times
from app.planning.problem import Candidates, Problem
from app.planning.system import FloatArray

P = ParamSpec("P")
R = TypeVar("R")


class Engine:
    """Runs samplings in the order in which they come, each on all of the network's threads.

    Args:
        num_threads: CPU threads of the network.
    """

    def __init__(self, num_threads: int) -> None:
        self._thread = ThreadPoolExecutor(
            max_workers=1,
            thread_name_prefix="engine",
            initializer=torch.set_num_threads,
            initargs=(num_threads,),
        )

    def bind(self, model: Model) -> "EngineProposal":
        """Return `model` as a learned proposal that samples in this engine."""
        return EngineProposal(self._thread, model)

    def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Return `function(...)`, called in the engine's thread.

        Models are loaded and warmed up there too: OpenMP keeps a pool of threads for each thread
        that has ever used it, and once the pools together exceed the cores, all of them wait
        asleep instead of spinning (sampling then takes 2.5 times as long on two cores).
        """
        return self._thread.submit(function, *args, **kwargs).result()

    def close(self) -> None:
        """Finish what was submitted, then end the thread."""
        self._thread.shutdown()


class EngineProposal:
    """A `LearnedProposal`: one model of an engine."""

    def __init__(self, thread: ThreadPoolExecutor, model: Model) -> None:
        self._thread = thread
        self._model = model

    def sample(
        self,
        problem: Problem,
        noise: FloatArray,
        sampler: str,
        steps: int,
        guidance_scale: float,
    ) -> Candidates:
        """Denoise `noise` (K, H) into controls (K, H); blocks until the engine is done.

        Raises:
            InvalidStepCount: the model has fewer diffusion times than `steps`.
            ValueError: the model was not trained for the problem's plant and horizon.
        """
        if not self._model.fits(problem.system, problem.horizon):
            raise ValueError("the model was trained for another plant or horizon")
        submitted = perf_counter()
        future = self._thread.submit(
            _sample, self._model, problem, noise, sampler, steps, guidance_scale
        )
        controls, started = future.result()
        return Candidates(controls, queue_ms=(started - submitted) * 1e3)


@torch.inference_mode()
def _sample(
    model: Model,
    problem: Problem,
    noise: FloatArray,
    sampler: str,
    steps: int,
    guidance_scale: float,
) -> tuple[FloatArray, float]:
    """Return the controls (K, H) and the time at which sampling began."""
    started = perf_counter()
    manifest = model.manifest
    states = np.stack([problem.initial_state, problem.target_state])
    standardised = (states - manifest.state_mean) / manifest.state_std
    condition = torch.tensor(standardised.ravel(), dtype=torch.float32, device=model.device)
    controls = SAMPLERS[sampler](
        guided(model.unet, condition, guidance_scale),
        torch.tensor(noise, dtype=torch.float32, device=model.device),
        sampling_times(len(manifest.alphas_cumprod), steps),
        manifest.alphas_cumprod,
    )
    return controls.cpu().numpy().astype(np.float64) * manifest.control_scale, started
