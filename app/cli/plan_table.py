"""What `breakaway plan` prints: the measures of a plan; of several targets, a row for each."""

from collections.abc import Sequence
from textwrap import wrap
from typing import NamedTuple

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from app.wire.answers import CostReport, MultistepPlanResponse, PlanResponse, Segment, TimingReport
from app.wire.requests import MultistepPlanRequest, PlanRequest
from app.wire.uncertainty import CVaR, RobustnessReport

HEADING_WIDTH = 8
"""Of a unit in the heading of a column, in characters."""


class Measure(NamedTuple):
    """A number that is shown, and its unit."""

    name: str
    text: str
    unit: str = ""


def print_plan(
    console: Console,
    request: PlanRequest | MultistepPlanRequest,
    answer: PlanResponse | MultistepPlanResponse,
) -> None:
    """Print what a plan is worth and what it took; what the answer does not say is left out."""
    model = f" with {answer.model.name}/{answer.model.version}" if answer.model else ""
    console.print(f"{answer.method}{model}, seed {answer.seed}\n", style="bold", highlight=False)
    if isinstance(request, MultistepPlanRequest):
        assert isinstance(answer, MultistepPlanResponse)
        console.print(_by_segment(request, answer), "")
        measures = _over_all_segments(answer)
    else:
        assert isinstance(answer, PlanResponse)
        measures = _measures(answer, answer.control_unit)
        if answer.refinement is not None:
            measures.append(Measure("error unrefined", f"{answer.refinement.error_before:.6f}"))
        if answer.robustness is not None:
            measures += _robustness(answer.robustness)
    table = _new_table(show_header=False)
    for measure in [*measures, *_expense(answer.cost, answer.timing_ms)]:
        table.add_row(measure.name, f"{measure.text} {measure.unit}".rstrip())
    console.print(table)
    segments: Sequence[Segment] = (
        answer.segments if isinstance(answer, MultistepPlanResponse) else [answer]
    )
    for number, segment in enumerate(segments, 1):
        if segment.reachability is not None and not segment.reachability.reachable:
            target = f"Target {number} is" if len(segments) > 1 else "The target is"
            console.print(
                f"\n{target} not reachable in {len(segment.controls)} steps: at best "
                f"{segment.reachability.floor:.3g} m off.",
                highlight=False,
            )


def _by_segment(request: MultistepPlanRequest, answer: MultistepPlanResponse) -> Table:
    table = _new_table(show_header=True)
    table.add_column("target\n(m, m/s)", vertical="bottom", no_wrap=True)
    rows = [
        {measure.name: measure for measure in _measures(segment, answer.control_unit)}
        for segment in answer.segments
    ]
    # The longest has all that some row has.
    longest = max(rows, key=len)
    for measure in longest.values():
        heading = "\n".join([*measure.name.split(), *wrap(measure.unit, HEADING_WIDTH)])
        table.add_column(heading, justify="right", vertical="bottom")
    for target, row in zip(request.targets, rows, strict=True):
        texts = [row[name].text if name in row else "0" for name in longest]
        table.add_row("{:g}, {:g}".format(*target), *texts)
    return table


def _new_table(show_header: bool) -> Table:
    """Return a table so narrow that all measures of a segment have room in 80 columns."""
    return Table(box=SIMPLE, show_edge=False, padding=(0, 1, 0, 0), show_header=show_header)


def _measures(segment: Segment, control_unit: str) -> list[Measure]:
    squared = f"({control_unit})²" if "/" in control_unit else f"{control_unit}²"
    measures = [Measure("terminal error", f"{segment.terminal_error:.6f}")]
    if segment.reachability is not None:
        measures.append(Measure("floor", f"{segment.reachability.floor:.6f}"))
        if segment.reachability.floor_error:
            measures.append(Measure("floor error", f"{segment.reachability.floor_error:.1e}", "m"))
    if segment.gap is not None:
        measures.append(Measure("gap", f"{segment.gap:.1e}"))
    if segment.robustness is not None:
        measures.append(_risk(segment.robustness))
    return [
        *measures,
        Measure("control energy", f"{segment.control_energy:.3f}", squared),
        Measure("control smoothness", f"{segment.control_smoothness:.3f}", squared),
        Measure("stuck steps", f"{segment.stuck_steps}"),
    ]


def _risk(robustness: RobustnessReport) -> Measure:
    """Return the risk over uncertain plants, by its name."""
    risk = robustness.risk
    name = f"CVaR {risk.cvar:g}" if isinstance(risk, CVaR) else risk
    return Measure(f"{name} error", f"{robustness.value:.6f}")


def _robustness(robustness: RobustnessReport) -> list[Measure]:
    """Return what a plan is worth on uncertain plants, beside the risk."""
    plants = f"on {robustness.num_systems} plants:"
    measures = [
        Measure(f"{plants} median", f"{robustness.median_error:.6f}"),
        Measure("90 % within", f"{robustness.p90_error:.6f}"),
        Measure("worst", f"{robustness.worst_error:.6f}"),
        *(
            Measure(f"share within {limit}", f"{100 * share:.0f} %")
            for limit, share in robustness.within.items()
        ),
        Measure("r.m.s.", f"{robustness.rms_error:.6f}"),
    ]
    if robustness.first_order_bound is not None:
        measures.append(
            Measure("least r.m.s. of any plan, about", f"{robustness.first_order_bound:.6f}")
        )
    return measures


def _over_all_segments(answer: MultistepPlanResponse) -> list[Measure]:
    measures = [
        Measure("final error", f"{answer.final_error:.6f}"),
        Measure("mean end error", f"{answer.mean_end_error:.6f}"),
    ]
    if answer.mean_end_floor is not None:
        measures.append(Measure("mean end floor", f"{answer.mean_end_floor:.6f}"))
    return [*measures, Measure("stuck steps", f"{answer.stuck_steps}")]


def _expense(cost: CostReport, timing: TimingReport) -> list[Measure]:
    return [
        Measure("network evaluations", f"{cost.network_evaluations}"),
        Measure("rollouts", f"{cost.rollouts}"),
        Measure("time", f"{timing.total:.2f}", "ms"),
    ]
