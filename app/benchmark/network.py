"""The network alone, by engine and number of rows."""

from collections.abc import Callable, Iterator

import numpy as np

from app.benchmark.pairing import median_ms
from app.benchmark.reference import Reference, gigaflops_of_product
from app.inference.job import Job
from app.inference.kernel import multiply
from app.inference.model import Model
from app.inference.row_threads import RowThreads
from app.inference.sampling import Sampling
from app.planning.methods.sampler import Sampler, SamplerSettings
from app.planning.problem import Problem

ROWS = (1, 2, 8, 16, 32, 64, 256, 1024)
PRODUCT_SIZE = 2048
TILE_PRODUCTS = 100
ONE_STEP = Sampler("ddim", SamplerSettings(1, 1.0, first_time=1.0, last_time=0.0))


def network(paper: Model, chosen: Model, reference: Reference, num_threads: int) -> Iterator[str]:
    """Measure a forward pass by eager PyTorch, TorchScript and the engine; yield Markdown.

    Of the paper's model, and by the engine also of the one that a service chooses. Operations are
    those of the paper's, counted as the layers define them, also where the engine does with fewer.
    """
    gigaflops = reference.operations_of_a_row() / 1e9
    library, tiles = gigaflops_of_product(PRODUCT_SIZE), _gigaflops_of_tiles(num_threads)
    peak = max(library, tiles)
    yield f"- a row takes {1e3 * gigaflops:.1f} MFLOP"
    yield f"- matrix product, PyTorch, {PRODUCT_SIZE} x {PRODUCT_SIZE}: {library:.0f} GFLOP/s"
    yield f"- matrix product, the kernel's tiles: {tiles:.0f} GFLOP/s"
    yield f"- share: of {peak:.0f} GFLOP/s"
    yield ""
    yield (
        "| rows | eager | TorchScript | engine | GFLOP/s eager / TorchScript / engine | share "
        f"| {chosen.label}, engine |"
    )
    yield "| ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    for rows in ROWS:
        calls = (*reference.forward_passes(rows), _forward_pass(paper, rows))
        times = [median_ms(call) for call in calls]
        rates = [gigaflops * rows / (ms / 1e3) for ms in times]
        yield (
            f"| {rows} | {' | '.join(f'{ms:.2f} ms' for ms in times)} "
            f"| {' / '.join(f'{rate:.0f}' for rate in rates)} | {rates[-1] / peak:.0%} "
            f"| {median_ms(_forward_pass(chosen, rows)):.2f} ms |"
        )


def _forward_pass(model: Model, rows: int) -> Callable[[], object]:
    """Return the engine's: the first step of a sampling without guidance."""
    horizon = model.manifest.horizon
    problem = Problem(np.zeros(2), np.array([0.5, 0.0]), horizon=horizon)
    noise = np.random.default_rng(0).standard_normal((rows, horizon))
    sampling = Sampling(Job(rows), model, problem, noise, ONE_STEP)
    batch = sampling.take(rows)
    return lambda: model.network.predict(*batch)


def _gigaflops_of_tiles(num_threads: int) -> float:
    """Return the GFLOP/s of the kernel's matrix product, of the size of a block's convolution."""
    threads = RowThreads(num_threads)
    rows, depth, columns = 64 * 8 * num_threads, 192, 64
    left, right = (np.ones(size, np.float32) for size in (rows * depth, depth * columns))
    out = np.empty(rows * columns, np.float32)

    def work(part: slice) -> None:
        # RowThreads counts rows as the network does: 64 positions each.
        first, count = 64 * part.start, 64 * (part.stop - part.start)
        for _ in range(TILE_PRODUCTS):
            multiply(
                left, first * depth, depth, right, 0,
                out, first * columns, columns, count, depth, columns,
            )  # fmt: skip

    milliseconds = median_ms(lambda: threads.share(rows // 64, work))
    threads.close()
    return TILE_PRODUCTS * 2 * rows * depth * columns / milliseconds / 1e6
