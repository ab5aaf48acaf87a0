"""The comparison is one of plans: all of them real, none below the floor, ours at it."""

import numpy as np
import pytest

from app.planning.objectives import TOLERANCE

pytest.importorskip("casadi")
pytest.importorskip("cma")


def test_no_planner_beats_the_floor_and_refinement_meets_it() -> None:
    from tests.compare_solvers import compare

    rows = {row.name: np.array(row.gaps) for row in compare(num_tasks=2, seed=0)}
    for gaps in rows.values():
        assert gaps.shape == (2,)
        assert np.all(np.isfinite(gaps))
        assert np.all(gaps >= -1e-9)
    assert np.all(rows["dataset prior, K = 16, refined"] <= TOLERANCE)
