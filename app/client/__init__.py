"""The client side: it speaks HTTP and shares the schemas, and knows nothing of the service."""

from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.batches import BatchFailure, BatchPlan, BatchProblem, PlanBatchRequest
from app.wire.identification import IdentifyRequest, IdentifyResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest

__all__ = [
    "AsyncPlannerClient",
    "BatchFailure",
    "BatchPlan",
    "BatchProblem",
    "IdentifyRequest",
    "IdentifyResponse",
    "MultistepPlanRequest",
    "MultistepPlanResponse",
    "PlanBatchRequest",
    "PlanRequest",
    "PlanResponse",
    "PlannerClient",
    "RequestRefused",
]
