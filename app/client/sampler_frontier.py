"""Error against network evaluations, for samplers of the learned model: paired, on the same tasks.

The tasks are the random multi-step ones; the paper's setting is what the others are compared with.
"""

from collections.abc import AsyncIterator, Iterator, Sequence
from dataclasses import asdict
from typing import NamedTuple

from app.client.multistep_random import Result, evaluate
from app.client.planner_client import PlannerClient
from app.client.statistics import paired_difference
from app.planning.methods import ActionDiffusion

PAPER = ActionDiffusion(sampler="paper")
SETTINGS = (
    PAPER,
    *(ActionDiffusion(sampler="ddim", steps=n, guidance_scale=s)
      for n, s in ((2, 1), (5, 1), (5, 1.5), (10, 1), (10, 1.5), (10, 2), (20, 2))),
    *(ActionDiffusion(sampler="dpm_solver", steps=n, guidance_scale=s)
      for n, s in ((1, 1), (2, 1), (4, 1), (2, 2), (3, 2), (4, 1.5), (4, 2), (6, 2), (10, 2))),
)  # fmt: skip
MARGIN = 0.005
"""A setting is not inferior if its mean end error is, at 95 %, at most this much above (m)."""


class Point(NamedTuple):
    """One setting and K on the frontier."""

    setting: ActionDiffusion
    num_candidates: int
    error: float
    """Mean end error, m."""
    difference: tuple[float, float, float]
    """Mean error less the paper's setting's, and its 95 % interval."""

    @property
    def inferior(self) -> bool:
        """Whether it may be worse than the paper's setting by more than the margin."""
        return self.difference[2] > MARGIN


async def measure(
    client: PlannerClient, budgets: Sequence[int], num_sequences: int, num_runs: int, seed: int
) -> AsyncIterator[Point]:
    """Evaluate every setting at every K of `budgets`.

    Raises:
        httpx.HTTPError: the service cannot be reached, or refuses a request.
    """
    for k in budgets:
        reference: Result | None = None
        for setting in SETTINGS:
            methods = {str(setting.name): asdict(setting)}
            async for result in evaluate(client, methods, [k], num_sequences, num_runs, seed):
                reference = reference or result
                yield Point(
                    setting,
                    k,
                    float(result.mean_end_errors.mean()),
                    paired_difference(result.mean_end_errors, reference.mean_end_errors),
                )


def report(points: list[Point]) -> Iterator[str]:
    """Write a table: a row for each setting, a column for each K.

    A cell is the mean end error and, in parentheses, its difference from the paper's setting with
    the 95 % interval; an asterisk marks what may be inferior.
    """
    budgets = sorted({point.num_candidates for point in points})
    yield f"| sampler | steps | s | evaluations | {' | '.join(f'K = {k}' for k in budgets)} |"
    yield f"| --- | ---: | ---: | ---: |{' --- |' * len(budgets)}"
    found = {(point.setting, point.num_candidates): point for point in points}
    for setting in dict.fromkeys(point.setting for point in points):
        _, steps, scale = setting.settings
        cells = " | ".join(_cell(found[setting, k]) for k in budgets)
        evaluations = setting.cost(1).network_evaluations
        yield f"| `{setting.sampler}` | {steps} | {scale:g} | {evaluations} | {cells} |"


def _cell(point: Point) -> str:
    mean, low, high = point.difference
    error = f"{point.error:.3f}{'*' if point.inferior else ''}"
    if point.setting == PAPER:
        return error
    return f"{error} ({mean:+.3f} [{low:+.3f}, {high:+.3f}])"
