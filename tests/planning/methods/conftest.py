"""What optimisers roll out, for tests that look into their iterations."""

import pytest

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, optimiser
from app.planning.methods.optimiser import Optimiser, Scored, score
from app.planning.problem import Problem


@pytest.fixture
def rolled_out(monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
    """Every population that optimisers roll out, in order."""
    populations: list[FloatArray] = []

    def recording(problem: Problem, controls: FloatArray) -> Scored:
        populations.append(controls.copy())
        return score(problem, controls)

    monkeypatch.setattr(optimiser, "score", recording)
    # Its kernel, into which nobody can look, does the same as the loop; see test_cem.py.
    monkeypatch.setattr(CEM, "improve", Optimiser.improve)
    return populations
