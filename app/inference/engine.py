"""The engine: one thread that owns the network and its device, one sampling at a time."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from time import perf_counter

import numpy as np
import torch

from app.inference.model_store import Model, ModelStore
from app.inference.row_threads import RowThreads
from app.inference.samplers import SAMPLERS, guided
from app.planning.problem import Candidates, Problem
from app.planning.system import FloatArray


class Engine:
    """Runs samplings in the order in which they come, each on all of the network's threads.

    Args:
        num_threads: CPU threads of the network.
    """

    def __init__(self, num_threads: int) -> None:
        self._thread = ThreadPoolExecutor(
            max_workers=1,
            thread_name_prefix="engine",
            # PyTorch's own threads would wait spinning for its next operation, on the cores that
            # the rows need.
            initializer=torch.set_num_threads,
            initargs=(1,),
        )
        self._row_threads = RowThreads(num_threads)

    def load(self, store: Path, device: torch.device) -> ModelStore:
        """Verify, load and warm up every model of a store, in the engine's thread.

        OpenMP, which PyTorch's threads are, keeps a pool of them for each thread that has ever
        used it, and once the pools together exceed the cores, all of them wait asleep instead of
        spinning.

        Raises:
            ModelRejected: one of them is not what its manifest says; none is loaded then.
        """
        return self._thread.submit(ModelStore.load, store, device, self._row_threads).result()

    def bind(self, model: Model) -> "EngineProposal":
        """Return `model` as a learned proposal that samples in this engine."""
        return EngineProposal(self._thread, model)

    def close(self) -> None:
        """Finish what was submitted, then end the threads."""
        self._thread.shutdown()
        self._row_threads.close()


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
    times, solve = SAMPLERS[sampler]
    controls = solve(
        guided(model.network, model.condition(problem), guidance_scale, len(noise)),
        torch.tensor(noise, dtype=torch.float32, device=model.device),
        times(len(manifest.alphas_cumprod), steps),
        manifest.alphas_cumprod,
    )
    return controls.cpu().numpy().astype(np.float64) * manifest.control_scale, started
