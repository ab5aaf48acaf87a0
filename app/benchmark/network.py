"""The network alone, by engine and number of rows."""

from collections.abc import Callable, Iterator

import numpy as np
import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from app.benchmark.pairing import median_ms
from app.benchmark.paper_sampler import PaperUNet
from app.inference.kernel.matrix_product import multiply
from app.inference.model_store import Model
from app.inference.networks.base import Network
from app.inference.networks.scripted import freeze
from app.inference.row_threads import RowThreads

ROWS = (1, 2, 8, 16, 32, 64, 256, 1024)
PRODUCT_SIZE = 2048


def network(
    model: Model, paper_unet: PaperUNet, script: torch.jit.ScriptModule, num_threads: int
) -> Iterator[str]:
    """Measure a forward pass by eager PyTorch, TorchScript and the engine; yield table lines.

    Operations are counted as the layers define them, also where the engine does with fewer.
    """
    horizon = model.manifest.horizon
    u, t, condition = torch.randn(1, 1, horizon), torch.zeros(1, dtype=torch.int64), torch.randn(4)
    with FlopCounterMode(display=False) as counter:
        paper_unet(u, t, condition.expand(1, -1))
    gigaflops = counter.get_total_flops() / 1e9
    peaks = _peak(num_threads)
    frozen = freeze(script)
    yield f"a row takes {1e3 * gigaflops:.1f} MFLOP"
    for name, peak in peaks.items():
        yield f"matrix product, {name}: {peak:.0f} GFLOP/s"
    peak = max(peaks.values())
    yield f"share: of {peak:.0f} GFLOP/s"
    yield ""
    yield "| rows | eager | TorchScript | engine | GFLOP/s eager / TorchScript / engine | share |"
    yield "| ---: | ---: | ---: | ---: | ---: | ---: |"
    for rows in ROWS:
        u, t = (
            torch.randn(rows, horizon),
            torch.randint(len(model.manifest.alphas_cumprod), (rows,)),
        )
        conditions = condition.expand(rows, -1)
        times = [
            median_ms(call)
            for call in (
                _call_eager(paper_unet, u, t, conditions),
                _call_script(frozen, u, t, conditions),
                _call(model.network, u, t, condition),
            )
        ]
        rates = [gigaflops * rows / (ms / 1e3) for ms in times]
        yield (
            f"| {rows} | {' | '.join(f'{ms:.2f} ms' for ms in times)} "
            f"| {' / '.join(f'{rate:.0f}' for rate in rates)} | {rates[-1] / peak:.0%} |"
        )


def _call_eager(unet: PaperUNet, u: Tensor, t: Tensor, condition: Tensor) -> Callable[[], Tensor]:
    def call() -> Tensor:
        noise: Tensor = unet(u.unsqueeze(1), t, condition).squeeze(1)
        return noise

    return call


def _call_script(
    frozen: torch.jit.ScriptModule, u: Tensor, t: Tensor, condition: Tensor
) -> Callable[[], Tensor]:
    keep = torch.ones(len(u), dtype=torch.bool)

    def call() -> Tensor:
        noise: Tensor = frozen(u.unsqueeze(1), t, condition, keep)
        return noise

    return call


def _call(network: Network, u: Tensor, t: Tensor, condition: Tensor) -> Callable[[], Tensor]:
    embedding = network.embed(condition)[0].repeat(len(u), 1)
    return lambda: network.predict(u, t, embedding)


def _peak(num_threads: int) -> dict[str, float]:
    """Return the GFLOP/s of matrix products by PyTorch's BLAS and by the kernel's tiles."""
    a = torch.randn(PRODUCT_SIZE, PRODUCT_SIZE)
    threads = RowThreads(num_threads)
    rows, depth, columns = 64 * 8 * num_threads, 192, 64
    left, right = (np.ones(size, np.float32) for size in (rows * depth, depth * columns))
    out = np.empty(rows * columns, np.float32)

    def work(part: slice) -> None:
        # RowThreads counts rows as the network does: 64 positions each.
        first, count = 64 * part.start, 64 * (part.stop - part.start)
        for _ in range(100):
            multiply(
                left, first * depth, depth, right, 0,
                out, first * columns, columns, count, depth, columns,
            )  # fmt: skip

    library = median_ms(lambda: a @ a)
    tiles = median_ms(lambda: threads.share(rows // 64, work))
    threads.close()
    return {
        f"PyTorch, {PRODUCT_SIZE} x {PRODUCT_SIZE}": 2 * PRODUCT_SIZE**3 / library / 1e6,
        "the kernel's tiles": 100 * 2 * rows * depth * columns / tiles / 1e6,
    }
