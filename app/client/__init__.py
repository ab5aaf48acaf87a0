"""The client side: it speaks HTTP and shares the schemas, and knows nothing of the service."""

from app.api.schemas import (
    MultistepPlanRequest,
    MultistepPlanResponse,
    PlanRequest,
    PlanResponse,
)
from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused

__all__ = [
    "AsyncPlannerClient",
    "MultistepPlanRequest",
    "MultistepPlanResponse",
    "PlanRequest",
    "PlanResponse",
    "PlannerClient",
    "RequestRefused",
]
