"""How fast a network takes rows, and how many at once it takes best; measured at the first start.

A model that comes while others serve is not timed on the cores that serve: it takes over the pace
of one like it, or a guess.
"""

import math
from time import perf_counter

import torch

from app.inference.model_card import Pace
from app.inference.networks.base import Network

SIZES = (16, 32, 64, 128, 256)
REPETITIONS = 7
OVERHEAD_SECONDS = 2e-4
"""What the engine does around each pass takes about so long."""
TOLERANCE = 1.1
"""Up to this much above the least time a row is as good: the fewer rows a tick takes, the sooner
the next one begins, with whoever has come meanwhile."""


@torch.inference_mode()
def measure_pace(network: Network, condition_size: int, horizon: int, device: torch.device) -> Pace:
    """Run batches of all `SIZES`, some tenths of a second; the least times are the least noisy."""
    embedding = network.embed(torch.zeros(condition_size, device=device))

    def seconds_per_row(rows: int) -> float:
        u_t = torch.zeros(rows, horizon, device=device)
        times = torch.zeros(rows, dtype=torch.int64, device=device)
        embeddings = embedding[:1].expand(rows, -1).contiguous()
        least = math.inf
        for _ in range(REPETITIONS):
            started = perf_counter()
            # A GPU is done only when its answer is here.
            network.predict(u_t, times, embeddings).cpu()
            least = min(least, perf_counter() - started)
        return (least + OVERHEAD_SECONDS) / rows

    paces = [Pace(rows, seconds_per_row(rows)) for rows in SIZES]
    least = min(pace.seconds_per_row for pace in paces)
    return next(pace for pace in paces if pace.seconds_per_row <= TOLERANCE * least)
