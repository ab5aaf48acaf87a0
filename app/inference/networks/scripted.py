"""The checkpoint's own TorchScript as a network: right for every one, on every device."""

import torch
from torch import Tensor

from app.inference.networks.base import Checkpoint
from app.inference.row_threads import ROWS_AT_A_TIME, RowThreads
from app.inference.torchscript import freeze


def run_script(
    script: torch.jit.ScriptModule, u_t: Tensor, t: Tensor, condition: Tensor, keep: Tensor
) -> Tensor:
    """Predict of `u_t` (B, H) with a checkpoint's network; (B, H).

    Args:
        script: the network.
        u_t: noisy controls.
        t: (B,) int64, diffusion times.
        condition: (B, C), standardised.
        keep: (B,) bool; False takes the null condition.

    Raises:
        RuntimeError: the network fails, or answers in the wrong shape.
    """
    prediction: Tensor = script(u_t.unsqueeze(1), t, condition, keep)[:, 0]
    if prediction.shape != u_t.shape:
        # Assigning it to the rows would broadcast it.
        raise RuntimeError(f"the output has shape {tuple(prediction.shape)}")
    return prediction


class ScriptedNetwork:
    """The checkpoint as it is.

    On a CPU its rows are shared out over `threads`, and run in batches of one size, filled up with
    zeros: so it leaves a core to whoever else needs it, and oneDNN, which keeps a compiled
    primitive for every shape that it has seen, sees one, however many rows the requests have.

    Args:
        checkpoint: whose network this is.
        threads: share out the rows.
    """

    def __init__(self, checkpoint: Checkpoint, threads: RowThreads) -> None:
        self._unet = freeze(checkpoint.script)
        self._threads = threads

    def embed(self, condition: Tensor) -> Tensor:
        """Return the condition and whether to keep it; E = C + 1."""
        embedding = condition.new_zeros(2, len(condition) + 1)
        embedding[0, :-1] = condition
        embedding[0, -1] = 1.0
        return embedding

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        """Predict as `Network.predict`.

        Raises:
            RuntimeError: the network fails, or answers in the wrong shape.
        """
        if u_t.device.type != "cpu":
            return self._run(u_t, t, embedding)
        prediction = torch.empty_like(u_t)

        @torch.inference_mode()
        def work(rows: slice) -> None:
            if torch.get_num_threads() > 1:
                torch.set_num_threads(1)
            count = rows.stop - rows.start
            batch = (_filled(part[rows], ROWS_AT_A_TIME) for part in (u_t, t, embedding))
            prediction[rows] = self._run(*batch)[:count]

        self._threads.share(len(u_t), work)
        return prediction

    def _run(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        return run_script(self._unet, u_t, t, embedding[:, :-1], embedding[:, -1] > 0)


def _filled(rows: Tensor, count: int) -> Tensor:
    """Return `rows` followed by as many of zeros as make `count`."""
    return torch.cat([rows, rows.new_zeros(count - len(rows), *rows.shape[1:])])
