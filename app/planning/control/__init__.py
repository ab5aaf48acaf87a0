"""Closed loop: controllers, a file each or a few, and runs of them on true plants."""

from typing import TypeAlias

from app.planning.control.feedback import PD, PID, PDFeedforward, TimeOptimalLaw
from app.planning.control.receding_horizon import RecedingHorizon

AnyController: TypeAlias = RecedingHorizon | PD | PID | PDFeedforward | TimeOptimalLaw
CONTROLLERS: tuple[type[AnyController], ...] = (
    RecedingHorizon,
    PD,
    PID,
    PDFeedforward,
    TimeOptimalLaw,
)

__all__ = [
    "CONTROLLERS",
    "PD",
    "PID",
    "AnyController",
    "PDFeedforward",
    "RecedingHorizon",
    "TimeOptimalLaw",
]
