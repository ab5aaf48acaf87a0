"""Where networks run, and the library that runs them."""

import torch

LIBRARY_VERSION = str(torch.__version__)
CPU = torch.device("cpu")


def choose_device() -> torch.device:
    """Return the GPU where there is one."""
    return torch.device("cuda") if torch.cuda.is_available() else CPU
