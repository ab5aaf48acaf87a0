"""What is printed of a plan."""

import io
from dataclasses import replace

import pytest
from rich.console import Console

from app.cli.plan_table import print_plan
from app.inference.engine import Engine
from app.inference.model_store import ModelStore
from app.serving.rates import Rates
from app.serving.service import PlanningService
from app.settings import Settings
from app.wire.answers import MultistepPlanResponse, PlanResponse
from app.wire.requests import MultistepPlanRequest, PlanRequest

FIELDS = {"initial_state": (0.0, 0.0), "method": "dataset_prior", "seed": 7, "refine": True}
ONE = PlanRequest.model_validate(FIELDS | {"target_state": (0.2, 0.0)})
SEVERAL = MultistepPlanRequest.model_validate(
    FIELDS | {"targets": [(-0.25, 0.1), (0.4, 0.0), (-0.123456, -0.0654321)]}
)
PER_SEGMENT = ["terminal", "floor", "gap", "energy", "smoothness", "stuck"]


@pytest.fixture(scope="module")
def service() -> PlanningService:
    return PlanningService(Settings(), ModelStore([]), Engine(1), Rates())


@pytest.fixture(scope="module")
def plan(service: PlanningService) -> PlanResponse:
    return service.plan(service.resolve(ONE))


@pytest.fixture(scope="module")
def multistep(service: PlanningService) -> MultistepPlanResponse:
    return service.plan_multistep(service.resolve(SEVERAL))


def printed(
    request: PlanRequest | MultistepPlanRequest, answer: PlanResponse | MultistepPlanResponse
) -> str:
    text = io.StringIO()
    print_plan(Console(file=text, width=80), request, answer)
    return text.getvalue()


def test_a_plan_is_shown_with_all_its_measures(plan: PlanResponse) -> None:
    assert plan.refinement is not None
    assert plan.reachability is not None
    shown = dict(line.split("  ", 1) for line in printed(ONE, plan).splitlines() if "  " in line)
    assert {name: text.strip() for name, text in shown.items()} == {
        "terminal error": f"{plan.terminal_error:.6f}",
        "error unrefined": f"{plan.refinement.error_before:.6f}",
        "floor": f"{plan.reachability.floor:.6f}",
        "gap": f"{plan.gap:.1e}",
        "control energy": f"{plan.control_energy:.3f} (m/s²)²",
        "control smoothness": f"{plan.control_smoothness:.3f} (m/s²)²",
        "stuck steps": f"{plan.stuck_steps}",
        "network evaluations": f"{plan.cost.network_evaluations}",
        "rollouts": f"{plan.cost.rollouts}",
        "time": f"{plan.timing_ms.total:.2f} ms",
    }
    assert printed(ONE, plan).startswith("dataset_prior, seed 7\n")


@pytest.mark.parametrize(("floor_error", "shown"), [(0.0, False), (1.234e-7, True)])
def test_how_far_the_floor_may_be_off_is_shown_where_it_is(
    plan: PlanResponse, floor_error: float, shown: bool
) -> None:
    assert plan.reachability is not None
    reachability = plan.reachability.model_copy(update={"floor_error": floor_error})
    text = printed(ONE, plan.model_copy(update={"reachability": reachability}))
    assert ("floor error          1.2e-07 m" in text) == shown
    assert ("floor error" in text) == shown


def test_a_target_out_of_reach_is_told_of_in_a_sentence(
    service: PlanningService, plan: PlanResponse
) -> None:
    far = ONE.model_copy(update={"target_state": (3.0, 0.0), "horizon": 20})
    answer = service.plan(service.resolve(far))
    assert answer.reachability is not None
    floor = f"{answer.reachability.floor:.3g}"
    said = f"The target is not reachable in 20 steps: at best {floor} m off.\n"
    assert said in printed(far, answer)
    assert "reachable" not in printed(ONE, plan)


def test_of_several_targets_that_out_of_reach_is_named(service: PlanningService) -> None:
    several = SEVERAL.model_copy(update={"targets": [(0.1, 0.0), (9.0, 0.0)]})
    text = printed(several, service.plan_multistep(service.resolve(several)))
    assert "Target 2 is not reachable in 64 steps: at best" in text
    assert text.count("not reachable") == 1


def test_a_plant_with_a_gain_has_units_of_control(
    plan: PlanResponse, multistep: MultistepPlanResponse
) -> None:
    system = replace(plan.system, control_gain=0.5)
    text = printed(ONE, plan.model_copy(update={"system": system}))
    assert f"control energy       {plan.control_energy:.3f} units of control²" in text
    several = printed(SEVERAL, multistep.model_copy(update={"system": system}))
    assert several.count("control²") == 2
    assert "m/s²" not in text + several
    assert max(map(len, several.splitlines())) <= 80
    assert "…" not in several


def test_a_floor_that_is_off_for_one_target_has_a_column_for_all(
    multistep: MultistepPlanResponse,
) -> None:
    first, second, *others = multistep.segments
    assert second.reachability is not None
    inexact = second.reachability.model_copy(update={"floor_error": 1.234e-7})
    segments = [first, second.model_copy(update={"reachability": inexact}), *others]
    text = printed(SEVERAL, multistep.model_copy(update={"segments": segments}))
    rows = [line for line in text.splitlines() if line.startswith(("-0.25,", "0.4, 0", "-0.12"))]
    assert [row.split()[4] for row in rows] == ["0", "1.2e-07", "0"]
    assert max(map(len, text.splitlines())) <= 80


def test_what_an_answer_does_not_say_is_left_out(plan: PlanResponse) -> None:
    absent = dict.fromkeys(("gap", "reachability", "refinement"))
    text = printed(ONE, plan.model_copy(update=absent))
    assert "terminal error" in text
    for name in ("gap", "floor", "error unrefined", "None"):
        assert name not in text


def test_several_targets_have_a_row_each_that_fits_a_terminal(
    multistep: MultistepPlanResponse,
) -> None:
    text = printed(SEVERAL, multistep)
    assert "…" not in text
    for heading in PER_SEGMENT:
        assert heading in text
    rows = text.splitlines()
    for target, segment in zip(SEVERAL.targets, multistep.segments, strict=True):
        (row,) = [row for row in rows if row.startswith("{:g}, {:g} ".format(*target))]
        assert f"{segment.terminal_error:.6f}" in row
        assert f"{segment.control_energy:.3f}" in row
        assert row.rstrip().endswith(f" {segment.stuck_steps}")


def test_several_targets_have_their_measures_together(multistep: MultistepPlanResponse) -> None:
    text = printed(SEVERAL, multistep)
    for line in (
        f"final error          {multistep.final_error:.6f}",
        f"mean end error       {multistep.mean_end_error:.6f}",
        f"mean end floor       {multistep.mean_end_floor:.6f}",
        f"stuck steps          {multistep.stuck_steps}",
        f"time                 {multistep.timing_ms.total:.2f} ms",
    ):
        assert line in text


def test_a_floor_that_several_targets_do_not_have_is_left_out(
    multistep: MultistepPlanResponse,
) -> None:
    absent = {"gap": None, "reachability": None}
    segments = [segment.model_copy(update=absent) for segment in multistep.segments]
    text = printed(
        SEVERAL, multistep.model_copy(update={"segments": segments, "mean_end_floor": None})
    )
    for name in ("gap", "floor", "None"):
        assert name not in text
