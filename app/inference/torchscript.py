"""TorchScript, the format of checkpoints: reading, freezing and writing it, here and nowhere else.

PyTorch calls it deprecated; that is known and planned for, and silenced in this one place.
"""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def _known_deprecation() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r".*torch\.jit\..*deprecated", DeprecationWarning)
        yield


def read_torchscript(checkpoint: bytes, device: torch.device) -> torch.jit.ScriptModule:
    """Return a checkpoint's network, to be run and not to be trained.

    Raises:
        RuntimeError: the bytes are no TorchScript.
    """
    with _known_deprecation():
        script: torch.jit.ScriptModule = torch.jit.load(  # type: ignore[no-untyped-call]
            io.BytesIO(checkpoint), map_location=device
        )
    for parameter in script.parameters():
        parameter.requires_grad_(False)
    return script.eval()


def freeze(script: torch.jit.ScriptModule) -> torch.jit.ScriptModule:
    """Return a network in evaluation mode as one that runs faster and has no parts."""
    with _known_deprecation():
        frozen: torch.jit.ScriptModule = torch.jit.freeze(script)
    return frozen


def to_torchscript(network: torch.nn.Module) -> bytes:
    """Script `network` on the CPU in evaluation mode; return the file's bytes."""
    buffer = io.BytesIO()
    with _known_deprecation():
        torch.jit.save(torch.jit.script(network.cpu().eval()), buffer)
    return buffer.getvalue()
