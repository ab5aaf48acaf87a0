"""The search itself, on a few tasks, and that what it found is there for all that is compared."""

import json

import pytest

from app.evaluation.circumstances import CIRCUMSTANCES
from tests import tune_controllers
from tests.tune_controllers import FILE, SEARCHES, cost, runs_of, tune


@pytest.fixture
def _few_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_controllers, "NUM_TASKS", 2)
    monkeypatch.setattr(tune_controllers, "NUM_PLANTS", 1)
    tune_controllers.tasks.cache_clear()


@pytest.mark.usefixtures("_few_tasks")
@pytest.mark.parametrize("name", SEARCHES)
@pytest.mark.parametrize("circumstances", ["none", "position-only"])
def test_every_point_of_the_cube_is_a_controller_that_runs(name: str, circumstances: str) -> None:
    search, given = SEARCHES[name], CIRCUMSTANCES[circumstances]
    for place in (0.0, 0.3, 0.999):
        runs = runs_of(search.make([place] * search.dimensions, given), given)
        assert len(runs) == 2
        assert 0.0 <= cost(runs) < 30.0


@pytest.mark.usefixtures("_few_tasks")
def test_the_search_finds_better_settings_than_its_first_ones() -> None:
    *_, little = tune(("pd", "none", 1))
    *_, more = tune(("pd", "none", 10))

    assert more["cost"] <= little["cost"]
    assert more["evaluations"] >= 40


def test_settings_were_found_for_every_controller_in_all_circumstances() -> None:
    found = json.loads(FILE.read_text())

    assert {name: set(controllers) for name, controllers in found.items()} == {
        name: set(SEARCHES) for name in CIRCUMSTANCES
    }
