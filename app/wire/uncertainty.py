"""Uncertainty: in requests, what a plan is to cope with; in answers, how well it does."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from app.planning.plant.system import System
from app.planning.uncertainty.relative import Relative
from app.planning.uncertainty.risk import Risk
from app.planning.uncertainty.uncertainty import (
    DEFAULT_MOTIONS,
    FEW_MOTIONS,
    MAX_MOTIONS,
    MAX_SYSTEMS,
)
from app.wire.model import ARRAY, Asked, WireModel

NUM_SYSTEMS = 32


class CVaR(Asked):
    """The mean error over the worst of the plants."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"cvar": 0.9}]})

    cvar: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = Field(
        description="The share of the plants that do not count: 0.9 for the worst tenth, 1 for the "
        "worst plant."
    )


RiskField: TypeAlias = Literal["mean", "worst"] | CVaR


class Ensemble(Asked):
    """The plants that may be the true one: given, or drawn."""

    systems: Annotated[list[System], ARRAY] | None = Field(
        None,
        description="The plants, each as likely as another; of the time step and the control "
        "limits of `system`.",
        min_length=1,
        max_length=MAX_SYSTEMS,
    )
    relative: Relative | None = Field(
        None,
        description="Draw the plants around `system`: by what share of its value each parameter "
        "may be off, uniform and independent. Draws come from the request's seed.",
    )
    num_systems: Annotated[int, Field(ge=1, le=MAX_SYSTEMS)] = Field(
        NUM_SYSTEMS, description="How many plants to draw with `relative`."
    )

    @model_validator(mode="after")
    def _either_given_or_drawn(self) -> Self:
        if (self.systems is None) == (self.relative is None):
            raise ValueError("either systems or relative says which plants there may be")
        return self


class Uncertainty(Ensemble):
    """The plants that may be the true one, and what their errors are to be as one number."""

    risk: RiskField = Field("mean", description="What ranks plans, over the plants' errors.")
    robust: bool = Field(
        True,
        description="False makes the plan for `system` alone, as without `uncertainty`, and only "
        "says what it is worth on the plants.",
    )
    num_motions: Annotated[int, Field(ge=1, le=MAX_MOTIONS)] | None = Field(
        None,
        description="With `refine`: motions that the search for a robust plan starts from, beside "
        "the candidates. More of them take longer, and find better plans. By default "
        f"{DEFAULT_MOTIONS}, or {FEW_MOTIONS} beside candidates of a model that knows of "
        "uncertainty.",
    )

    @property
    def measure(self) -> Risk:
        """The risk as the domain has it."""
        if isinstance(self.risk, CVaR):
            return Risk("cvar", self.risk.cvar)
        return Risk(self.risk)


class ToldReport(WireModel):
    """What the model was told: by what share of its value each parameter may be off."""

    static_friction: float
    coulomb_friction: float
    viscous_damping: float
    control_gain: float
    left_out: list[str] | None = Field(
        None,
        description="What these shares do not say of the plants, in words: then they are the "
        "nearest that the model knows. Absent where they say it all.",
    )


class RobustnessReport(WireModel):
    """Terminal errors of the plan over the plants that may be the true one, m."""

    num_systems: int = Field(
        description="Plants that the plan was judged on: with `systems` those, with `relative` "
        "others than it was made with."
    )
    risk: RiskField
    value: float = Field(description="The risk of these errors.")
    mean_error: float
    median_error: float
    p90_error: float = Field(description="Nine in ten are no greater.")
    worst_error: float
    rms_error: float
    within: dict[str, float] = Field(
        description="Share of the plants whose error is at most so much, m."
    )
    nominal_error: float = Field(description="On `system` itself: the terminal error.")
    told: ToldReport | None = Field(
        None,
        description="Where a model that knows of uncertainty proposed the candidates. Others "
        "propose for `system` alone.",
    )
    first_order_bound: float | None = Field(
        None,
        description="The least r.m.s. error that any control sequence can have, to first order in "
        "the shares of `relative`. From rest to rest, without Stribeck's effect; absent otherwise.",
    )
    errors: list[float] | None = Field(
        None, description="(S,): of each plant. Where the ensemble is asked for, like `fan`."
    )
    fan: list[list[tuple[float, float]]] | None = Field(
        None,
        description="(at most 32, H+1, 2): the states of the plan on some of the plants, spread "
        "evenly over them.",
    )
