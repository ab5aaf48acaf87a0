"""The service as a client sees it: its start, what HTTP adds, its memory."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from time import perf_counter, sleep

import httpx
import numpy as np
import psutil

from app.benchmark.pairing import paired
from app.benchmark.quick_plans import METHOD as QUICK
from app.benchmark.quick_plans import NUM_CANDIDATES as QUICK_CANDIDATES
from app.inference.engine import EngineProposal
from app.planning.methods import CEM, ActionDiffusion
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.refinement import Refinement

PAIRS = 200
START_TIMEOUT_S = 60


def service(proposal: EngineProposal) -> Iterator[str]:
    """Start a service, ask it for plans, and the planner in this process for the same.

    Yields a line for each measurement.
    """
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
                yield _request(client, CEM(), 16, proposal)
                yield _request(client, ActionDiffusion(), 16, proposal)
                yield _request(client, QUICK, QUICK_CANDIDATES, proposal, Refinement())
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


def _request(
    client: httpx.Client,
    method: CEM | ActionDiffusion,
    num_candidates: int,
    proposal: EngineProposal,
    refinement: Refinement | None = None,
) -> str:
    problem = Problem(np.zeros(2), np.array([0.5, 0.0]))
    body = {
        "initial_state": [0.0, 0.0],
        "target_state": [0.5, 0.0],
        "method": asdict(method),
        "num_candidates": num_candidates,
        "seed": 0,
        "refine": refinement is not None,
    }
    over_http, in_process = paired(
        lambda: client.post("/plan", json=body).raise_for_status(),
        lambda: plan(
            problem, method, num_candidates, np.random.default_rng(0), proposal, refinement
        ),
        PAIRS,
    )
    return (
        f"{method.name}{', refined' if refinement else ''}, K = {num_candidates}, "
        f"{method.cost(num_candidates).network_evaluations} evaluations: {over_http:.2f} ms over "
        f"HTTP, {in_process:.2f} ms in process, HTTP adds {over_http - in_process:.2f} ms"
    )
