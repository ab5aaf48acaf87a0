"""The benchmarks one after the other, as a page of Markdown."""

from collections.abc import Iterator
from pathlib import Path

from app.benchmark.batches import batches
from app.benchmark.capacity import capacity
from app.benchmark.concurrency import concurrency
from app.benchmark.control import control
from app.benchmark.network import network
from app.benchmark.planning import planning
from app.benchmark.quick_plans import quick_plans
from app.benchmark.reference import Reference, use_threads
from app.benchmark.requests import requests
from app.benchmark.sampling import sampling
from app.benchmark.service import service
from app.evaluation.entrants import PAPER_MODEL
from app.inference.device import CPU
from app.inference.engine import Engine
from app.inference.job import Job
from app.inference.verification import verify
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON
from app.planning.warm_up import warm_up, warm_up_loops


def run(store: Path, num_threads: int) -> Iterator[str]:
    """Measure the network with the paper's model, and plans with the one that a service chooses.

    Yields lines of Markdown.

    Raises:
        ModelRejected: a model of the store is not what its manifest says.
        UnknownModel: the store has no such model.
    """
    warm_up()
    warm_up_loops()
    engine = Engine(num_threads)
    models = engine.load(store, CPU)
    paper, chosen = models.find(PAPER_MODEL), models.covering(System(), DEFAULT_HORIZON)
    manifest, checkpoint = verify(store / paper.manifest.name / str(paper.manifest.version))
    reference = Reference(checkpoint, manifest)
    # After the engine, which limits PyTorch to one thread: the references have them all.
    use_threads(num_threads)
    # One job for all that is measured: the engine has no other to share its rows with.
    job = Job(rows_left=0)
    proposal, samplers = engine.bind(chosen, job), chosen.manifest.samplers
    yield "# Benchmark\n"
    yield f"{paper.label}, by default {chosen.label}; {num_threads} threads"
    yield "\n## The network\n"
    yield from network(paper, chosen, reference, num_threads)
    yield "\n## Sampling, beside the paper's sampler in eager PyTorch\n"
    yield from sampling(engine.bind(paper, job), reference, proposal, samplers)
    yield "\n## Planning\n"
    yield quick_plans(proposal, chosen.manifest)
    yield from planning()
    yield "\n## The service\n"
    yield from service(chosen)
    yield from requests()
    yield "\n## Plans a core\n"
    yield from capacity()
    yield "\n## Many requests at once\n"
    yield from concurrency()
    yield "\n## Many problems in one request\n"
    yield from batches()
    yield "\n## Closed loop\n"
    yield from control()
    engine.close()
