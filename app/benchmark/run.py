"""The benchmarks one after the other."""

from collections.abc import Iterator
from pathlib import Path

import torch

from app.benchmark.concurrency import company
from app.benchmark.network import network
from app.benchmark.paper_sampler import PaperUNet
from app.benchmark.planning import planning
from app.benchmark.quick_plans import quick_plans
from app.benchmark.sampling import sampling
from app.benchmark.service import service
from app.inference.engine import Engine
from app.inference.job import Job
from app.inference.model_store import read_torchscript
from app.inference.verification import verify
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON
from app.planning.warm_up import warm_up


def run(store: Path, num_threads: int) -> Iterator[str]:
    """Measure everything with the model of the nominal plant; yield lines of Markdown.

    Raises:
        ModelRejected: a model of the store is not what its manifest says.
        UnfitModel: the store has no model of the nominal plant.
    """
    warm_up()
    engine = Engine(num_threads)
    model = engine.load(store, torch.device("cpu")).fitting(System(), DEFAULT_HORIZON)
    _, checkpoint = verify(store / model.manifest.name / str(model.manifest.version))
    script = read_torchscript(checkpoint, model.device)
    paper_unet = PaperUNet(script.state_dict())
    # After the engine, which limits PyTorch to one thread: the references have them all.
    torch.set_num_threads(num_threads)
    # One job for all that is measured: the engine has no other to share its rows with.
    proposal = engine.bind(model, Job(rows_left=0))
    yield f"{model.label}, {num_threads} threads\n\n## The network\n"
    with torch.inference_mode():
        yield from network(model, paper_unet, script, num_threads)
    yield "\n## Sampling, beside the paper's sampler in eager PyTorch\n"
    yield from sampling(model, proposal, paper_unet)
    yield "\n## Planning\n"
    yield quick_plans(proposal, model.manifest.horizon)
    yield from planning()
    yield "\n## The service\n"
    yield from service(model)
    yield "\n## In company\n"
    yield from company()
    engine.close()
