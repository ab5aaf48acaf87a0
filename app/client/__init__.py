"""The client side: it speaks HTTP and shares the schemas, and knows nothing of the service."""

from app.client.control_client import AsyncControlClient, ControlClient
from app.client.control_session import SessionEnded
from app.client.planner_client import AsyncPlannerClient, PlannerClient, RequestRefused
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.batches import BatchFailure, BatchPlan, BatchProblem, PlanBatchRequest
from app.wire.control import ControlRequest, ControlResponse
from app.wire.identification import IdentifyRequest, IdentifyResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest
from app.wire.sessions import Start
from app.wire.simulation import SimulateRequest, SimulateResponse

__all__ = [
    "AsyncControlClient",
    "AsyncPlannerClient",
    "BatchFailure",
    "BatchPlan",
    "BatchProblem",
    "ControlClient",
    "ControlRequest",
    "ControlResponse",
    "IdentifyRequest",
    "IdentifyResponse",
    "MultistepPlanRequest",
    "MultistepPlanResponse",
    "PlanBatchRequest",
    "PlanRequest",
    "PlanResponse",
    "PlannerClient",
    "RequestRefused",
    "SessionEnded",
    "SimulateRequest",
    "SimulateResponse",
    "Start",
]
