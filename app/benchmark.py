"""Speed, as ratios and medians measured side by side in one run: `breakaway bench`.

The NumPy reference lives here and nowhere else.
"""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from statistics import median
from time import perf_counter, sleep

import httpx
import numpy as np
import psutil

from app.planning.methods import CEM, DatasetPrior
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.refinement import Refinement
from app.planning.system import FloatArray, System, rollout
from app.planning.warm_up import warm_up

PAIRS = 200
TASKS = 1000
EXACT_GAP = 1e-6
START_TIMEOUT_S = 60


def run() -> Iterator[str]:
    """Run every benchmark; yield a line for each."""
    warm_up()
    yield _rollouts()
    yield _cem()
    yield _refined()
    yield from _service()


def numpy_rollout(system: System, initial_state: FloatArray, controls: FloatArray) -> FloatArray:
    """Roll out `controls` (K, H) with NumPy, vectorised over K; return the states (K, H+1, 2)."""
    num_candidates, horizon = controls.shape
    states = np.empty((num_candidates, horizon + 1, 2))
    states[:, 0] = initial_state
    position, velocity = states[:, 0, 0].copy(), states[:, 0, 1].copy()
    for k in range(horizon):
        control = controls[:, k]
        at_rest = np.abs(velocity) < system.velocity_threshold
        friction = system.coulomb_friction * np.sign(np.where(at_rest, control, velocity))
        drag = np.where(at_rest, 0.0, system.viscous_damping * velocity)
        following = velocity + system.time_step * (control - friction - drag)
        reversed_ = ~at_rest & (following * velocity < 0)
        stuck = at_rest & (np.abs(control) <= system.static_friction)
        velocity = np.where(reversed_ | stuck, 0.0, following)
        position = position + system.time_step * velocity
        states[:, k + 1, 0], states[:, k + 1, 1] = position, velocity
    return states


def _paired(first: Callable[[], object], second: Callable[[], object]) -> tuple[float, float]:
    """Call the two in turn; return the median milliseconds of each."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(PAIRS):
        for call, durations in zip((first, second), times, strict=True):
            started = perf_counter()
            call()
            durations.append((perf_counter() - started) * 1e3)
    return median(times[0]), median(times[1])


def _rollouts() -> str:
    system, start = System(), np.zeros(2)
    controls = np.random.default_rng(0).uniform(-0.9, 0.9, (512, 64))
    kernel, reference = (f(system, start, controls) for f in (rollout, numpy_rollout))
    if not np.allclose(kernel, reference, atol=1e-12):
        raise AssertionError("the kernel and the NumPy reference disagree")
    compiled, vectorised = _paired(
        lambda: rollout(system, start, controls), lambda: numpy_rollout(system, start, controls)
    )
    return (
        f"rollouts of (512, 64): compiled {compiled:.3f} ms, NumPy {vectorised:.3f} ms, "
        f"ratio {vectorised / compiled:.0f}"
    )


def _cem() -> str:
    problem, rng = Problem(np.zeros(2), np.array([0.5, 0.0])), np.random.default_rng(0)
    large, small = _paired(
        lambda: plan(problem, CEM(), 512, rng), lambda: plan(problem, CEM(), 16, rng)
    )
    return f"cem, 40 iterations: {large:.1f} ms a plan with K = 512, {small:.2f} ms with K = 16"


def _refined() -> str:
    """Plan random tasks: starts in the training range, targets at rest in [-1, 1] m."""
    rng = np.random.default_rng(0)
    plans = []
    times = []
    for _ in range(TASKS):
        start = np.array([rng.uniform(-1, 1), rng.uniform(-0.5, 0.5)])
        problem = Problem(start, np.array([rng.uniform(-1, 1), 0.0]))
        started = perf_counter()
        plans.append(plan(problem, DatasetPrior(), 16, rng, refinement=Refinement()))
        times.append((perf_counter() - started) * 1e3)
    reachable = np.array([made.reachability.reachable for made in plans])
    gaps = np.array([made.gap for made in plans])
    return (
        f"dataset_prior with K = 16, refined, {TASKS} tasks: {median(times):.2f} ms a plan; "
        f"{np.mean(gaps[reachable] < EXACT_GAP):.2%} of the {reachable.sum()} reachable targets "
        f"within 1e-6, the others on average {gaps[~reachable].mean():.0e} from their floor"
    )


def _service() -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = perf_counter()
    command = [sys.executable, "-m", "app", "serve", "--port", str(port), "--log-level", "error"]
    with subprocess.Popen(command) as server:
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
                _wait_until_ready(client, server)
                yield f"start to ready: {perf_counter() - started:.1f} s"
                yield _overhead(client)
            memory = psutil.Process(server.pid).memory_info().rss / 2**20
            yield f"resident memory of the service afterwards: {memory:.0f} MiB"
        finally:
            server.terminate()


def _wait_until_ready(client: httpx.Client, server: "subprocess.Popen[bytes]") -> None:
    deadline = perf_counter() + START_TIMEOUT_S
    while True:
        try:
            if client.get("/readyz").is_success:
                return
        except httpx.TransportError:
            pass
        if server.poll() is not None or perf_counter() > deadline:
            raise TimeoutError("the service did not become ready")
        sleep(0.05)


def _overhead(client: httpx.Client) -> str:
    problem = Problem(np.zeros(2), np.array([0.5, 0.0]))
    body = {
        "initial_state": [0.0, 0.0],
        "target_state": [0.5, 0.0],
        "method": "cem",
        "num_candidates": 16,
        "seed": 0,
    }
    over_http, in_process = _paired(
        lambda: client.post("/plan", json=body).raise_for_status(),
        lambda: plan(problem, CEM(), 16, np.random.default_rng(0)),
    )
    return (
        f"cem with K = 16: {over_http:.2f} ms over HTTP, {in_process:.2f} ms in process, "
        f"HTTP adds {over_http - in_process:.2f} ms"
    )
