"""Answers: what a service makes of a request."""

from pydantic import ConfigDict, Field

from app.planning.plant.system import System
from app.wire.model import WireModel
from app.wire.uncertainty import RobustnessReport


class ModelReference(WireModel):
    """The checkpoint behind a plan."""

    model_config = ConfigDict(protected_namespaces=())

    name: str
    version: str
    sha256: str


class CostReport(WireModel):
    """What a plan took."""

    network_evaluations: int = Field(
        description="Forward passes of the network, each over all candidates."
    )
    rollouts: int = Field(
        description="Control sequences rolled out, over the whole horizon or, in a refinement, a "
        "part of it."
    )


class ReachabilityReport(WireModel):
    """How near any plan could come to the target, by the physics alone."""

    reachable: bool = Field(description="Whether the floor is zero, to within rounding.")
    floor: float = Field(description="Least terminal error over all admissible controls.")
    floor_error: float = Field(
        0.0, description="How far the floor may be off, m: 0 where it is exact."
    )
    nearest_state: tuple[float, float] = Field(description="A state at that distance.")
    minimum_steps: int | None = Field(
        None, description="Fewest steps in which the target can be reached; absent if it cannot."
    )


class RefinementReport(WireModel):
    """What refinement did to the best terminal error."""

    error_before: float = Field(description="Of the best candidate as proposed.")
    error_after: float = Field(
        description="Of the plan: never above `error_before` by more than rounding, 1e-12, but "
        "where `uncertainty` ranks plans by their risk."
    )
    replaced: bool = Field(
        description="Whether a plan traced through the reachable set, or found for uncertain "
        "plants, took the place of the selected candidate."
    )


class TimingReport(WireModel):
    """Wall-clock milliseconds in the server."""

    queue: float = Field(description="Waiting for a free core or for the network.")
    propose: float
    refine: float
    rollout: float = Field(description="Rolling out, ranking and measuring.")
    total: float


class CandidatesReport(WireModel):
    """All candidates, in the order in which they were proposed."""

    controls: list[list[float]] = Field(description="(K, H), units of control.")
    terminal_errors: list[float] = Field(description="(K,).")
    states: list[list[tuple[float, float]]] | None = Field(None, description="(K, H+1, 2).")


class ReachableSet(WireModel):
    """Where the plant can be after the horizon, whatever the controls."""

    polygons: list[list[tuple[float, float]]] = Field(
        description="Their union is the set, to within a hundredth of its width: corners, position "
        "(m) and velocity (m/s), in order."
    )
    at_rest: list[tuple[float, float]] = Field(
        description="Intervals of positions (m) at which it can be at rest."
    )


class DenoisingReport(WireModel):
    """The candidates on their way from noise to plans: before the S steps, and after each."""

    controls: list[list[list[float]]] = Field(
        description="(S+1, K, H), units of control; noise exceeds the limits. The last ones are "
        "the candidates, before any refinement."
    )
    terminal_errors: list[list[float]] = Field(
        description="(S+1, K): of these controls, held to the limits."
    )
    states: list[list[list[tuple[float, float]]]] | None = Field(
        None, description="(S+1, K, H+1, 2): the same."
    )


class Segment(WireModel):
    """A plan: the best candidate, and the measures of that very rollout."""

    controls: list[float] = Field(description="u[0:H], units of control.")
    states: list[tuple[float, float]] | None = Field(
        None, description="(H+1, 2): position (m) and velocity (m/s)."
    )
    terminal_error: float = Field(description="||x_H - x*||_2.")
    gap: float | None = Field(
        None, description="Terminal error less its floor, where that was asked for."
    )
    reachability: ReachabilityReport | None = None
    refinement: RefinementReport | None = Field(None, description="Absent without `refine`.")
    robustness: RobustnessReport | None = Field(None, description="Absent without `uncertainty`.")
    control_energy: float = Field(description="sum of u_k^2, (units of control)^2.")
    control_smoothness: float = Field(description="sum of (u_{k+1} - u_k)^2, (units of control)^2.")
    stuck_steps: int = Field(
        description="Steps at rest, below the threshold of static friction and off the target."
    )
    diversity: float = Field(
        description="How far the candidates lie apart as they were ranked: the standard deviation "
        "of their controls, its root mean square over the steps, units of control."
    )
    cost: CostReport
    timing_ms: TimingReport
    candidates: CandidatesReport | None = None
    candidate_errors: list[float] | None = Field(
        None, description="(K,): terminal errors of the candidates, as they were ranked."
    )
    reachable_set: ReachableSet | None = None
    denoising: DenoisingReport | None = None


class _Provenance(WireModel):
    method: str
    model: ModelReference | None = Field(None, description="Absent for methods that need no model.")
    seed: int
    system: System = Field(description="The plant that was planned for.")
    predicted_initial_state: tuple[float, float] | None = Field(
        None,
        description="Where the plan starts, position (m) and velocity (m/s): the state that the "
        "pending controls lead to. Absent without them.",
    )

    @property
    def control_unit(self) -> str:
        """The unit of control, as far as the plant itself says it."""
        return "m/s²" if self.system.control_gain == 1 else "units of control"


class PlanResponse(Segment, _Provenance):
    """Answer to `POST /plan`."""


class MultistepPlanResponse(_Provenance):
    """Answer to `POST /plan_multistep`."""

    segments: list[Segment]
    controls: list[float] = Field(description="All segments' controls, (M*H,).")
    states: list[tuple[float, float]] | None = Field(None, description="(M*H+1, 2).")
    final_error: float = Field(description="Terminal error of the last segment.")
    mean_end_error: float = Field(description="Terminal error averaged over the segments.")
    mean_end_floor: float | None = Field(
        None,
        description="Floor of the terminal error averaged over the segments, each from its start.",
    )
    stuck_steps: int
    cost: CostReport
    timing_ms: TimingReport
