"""The planning methods, a file each."""

from typing import TypeAlias

from app.planning.methods.action_diffusion import ActionDiffusion, Learned
from app.planning.methods.cem import CEM
from app.planning.methods.dataset_prior import DatasetPrior
from app.planning.methods.icem import ICEM
from app.planning.methods.mppi import MPPI
from app.planning.methods.uniform import Uniform
from app.planning.methods.warm_started import WarmStarted

AnyOptimiser: TypeAlias = CEM | ICEM | MPPI
AnyMethod: TypeAlias = ActionDiffusion | DatasetPrior | Uniform | AnyOptimiser
__all__ = [
    "CEM",
    "ICEM",
    "METHODS",
    "MPPI",
    "OPTIMISERS",
    "ActionDiffusion",
    "AnyMethod",
    "AnyOptimiser",
    "DatasetPrior",
    "Learned",
    "Uniform",
    "WarmStarted",
]

OPTIMISERS: tuple[type[AnyOptimiser], ...] = (CEM, ICEM, MPPI)
METHODS: tuple[type[AnyMethod], ...] = (ActionDiffusion, DatasetPrior, Uniform, *OPTIMISERS)
