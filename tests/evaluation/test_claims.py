"""The kinds of claims: what confirms them, and what their evidence says."""

import pandas as pd
import pytest

from app.evaluation.case import cases_of
from app.evaluation.claims import Lead, lead_over, lower, lowest
from app.evaluation.entrants import CEM, MPPI, PAPER_DIFFUSION
from app.evaluation.statistics import Interval

SURE, DOUBTFUL = Interval(-0.2, -0.3, -0.1), Interval(-0.2, -0.5, 0.1)


def test_a_lead_is_paired_at_each_place() -> None:
    data = pd.DataFrame(
        [
            (entrant.label, k, task, error + task)
            for entrant, error in ((PAPER_DIFFUSION, 0.1), (CEM, 0.3))
            for k in (16, 32)
            for task in range(3)
        ],
        columns=["entrant", "num_candidates", "task", "error"],
    )
    lead = lead_over(CEM, cases_of(data, [PAPER_DIFFUSION], num_candidates=[16, 32]), "error")
    assert str(lead) == (
        "Action Diffusion less CEM (40 it.): -0.200 [-0.200, -0.200] m at K = 16, "
        "-0.200 [-0.200, -0.200] m at K = 32."
    )


@pytest.mark.parametrize(
    ("differences", "confirmed"),
    [
        ({"K = 16": SURE, "K = 32": SURE}, True),
        ({"K = 16": SURE, "K = 32": DOUBTFUL}, False),
    ],
)
def test_lower_means_a_whole_interval_below_zero_at_every_place(
    differences: dict[str, Interval], confirmed: bool
) -> None:
    claim = lower("It is lower.", Lead("CEM", {"K = 16": SURE}), Lead("MPPI", differences))
    assert claim.confirmed == confirmed
    assert claim.evidence.startswith("Action Diffusion less CEM: -0.200 [-0.300, -0.100] m at K")
    assert "Action Diffusion less MPPI: " in claim.evidence


def test_a_lead_narrows_if_the_last_difference_is_nearer_to_zero() -> None:
    shrunk = Interval(-0.1, -0.2, 0.0)
    assert Lead("CEM", {"K = 16": SURE, "K = 32": shrunk}).narrows
    assert not Lead("CEM", {"K = 16": shrunk, "K = 32": SURE}).narrows


@pytest.mark.parametrize(("other", "confirmed"), [(2.0, True), (1.0, False), (0.5, False)])
def test_the_lowest_is_lower_than_each_of_the_others_at_every_place(
    other: float, confirmed: bool
) -> None:
    values = {"K = 16": {CEM: 1.0, MPPI: 2.0}, "K = 32": {CEM: 1.0, MPPI: other}}
    claim = lowest("It is the lowest.", CEM, values, "{:.1f} m")
    assert claim.confirmed == confirmed
    assert claim.evidence == (
        f"K = 16: CEM (40 it.) 1.0 m, MPPI (40 it.) 2.0 m; "
        f"K = 32: CEM (40 it.) 1.0 m, MPPI (40 it.) {other:.1f} m."
    )
