"""The planning methods, a file each."""

from typing import TypeAlias

from app.planning.methods.action_diffusion import ActionDiffusion
from app.planning.methods.cem import CEM
from app.planning.methods.dataset_prior import DatasetPrior
from app.planning.methods.uniform import Uniform

AnyMethod: TypeAlias = ActionDiffusion | DatasetPrior | Uniform | CEM
__all__ = ["CEM", "METHODS", "ActionDiffusion", "AnyMethod", "DatasetPrior", "Uniform"]

METHODS: tuple[type[AnyMethod], ...] = (ActionDiffusion, DatasetPrior, Uniform, CEM)
