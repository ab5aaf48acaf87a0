"""What the README shows is what a user gets."""

import asyncio
import json
import re
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import fields
from pathlib import Path

import pytest
from rich.console import Console

from app.client import AsyncPlannerClient
from app.evaluation.entrants import ENTRANTS
from app.evaluation.run import evaluate
from app.evaluation.suites import SUITES
from app.planning.methods import METHODS
from app.planning.plant.system import System
from app.settings import SHIPPED_MODELS, Settings
from app.wire.answers import PlanResponse
from tests.cli.command import invoke
from tests.served import serving, wait_until_ready

REPORT = SHIPPED_MODELS / "dry-friction-fs0.7" / "1" / "evaluation"
ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
EVALUATION_PAGE = (ROOT / "app" / "evaluation" / "README.md").read_text()
LONGEST = 250
"""Lines that a newcomer can be asked to read."""


def test_it_is_short() -> None:
    assert len(README.splitlines()) <= LONGEST


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", REPORT / "report.md", *sorted(ROOT.glob("[amt]*/**/README.md"))],
    ids=str,
)
def test_every_link_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!https?://)([^)#]+)\)", page.read_text())
    for link in links:
        assert (page.parent / link).exists(), link


def test_the_request_shown_gets_the_answer_shown() -> None:
    request = json.loads(re.findall(r"-d '(\{.*?\})'", README, re.DOTALL)[0])
    shown = json.loads(re.findall(r"```json\n(.*?)```", README, re.DOTALL)[0].replace(" ...,", ""))
    with serving(Settings(model_store=SHIPPED_MODELS)) as client:
        wait_until_ready(client)
        answer = client.post("/plan", json=request).json()
    PlanResponse.model_validate(answer)
    assert list(answer) == list(shown)
    for field in ("method", "model", "seed", "system", "cost"):
        assert answer[field] == shown[field]
    # The network's last bits differ between processors, and the plan with them.
    assert answer["terminal_error"] == pytest.approx(shown["terminal_error"], abs=5e-3)


def test_the_machines_shown_are_planned_for() -> None:
    (command,) = re.findall(r"breakaway (plan .*--system .*)", README)
    (system,) = re.findall(r"`(\{\"static_friction.*?)`", README, re.DOTALL)
    for option in ((), ("--system", system)):
        done = invoke(*command.split(), *option, "--json", "-")
        assert done.exit_code == 0, done.stderr
        assert PlanResponse.model_validate_json(done.stdout).terminal_error < 1e-6


def test_every_parameter_of_a_plant_is_in_its_table() -> None:
    table = (ROOT / "app" / "api" / "README.md").read_text()
    for parameter in fields(System):
        assert f"`{parameter.name}`" in table


def test_every_method_is_in_the_table() -> None:
    for method in METHODS:
        assert f"| `{method().name}` |" in README


def test_every_suite_is_in_its_table() -> None:
    for name in SUITES:
        assert f"| `{name}` |" in EVALUATION_PAGE


def test_the_one_table_of_results_is_the_report_s() -> None:
    report = {_cells(line) for line in (REPORT / "report.md").read_text().splitlines()}
    labels = {entrant.label for entrant in ENTRANTS}
    rows = [cells for cells in map(_cells, README.splitlines()) if cells[0] in labels]
    assert len(rows) > 5
    for row in rows:
        assert row in report


def _cells(line: str) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in line.strip("|").split("|"))


@pytest.mark.slow
def test_the_report_comes_of_its_answers(tmp_path: Path) -> None:
    shutil.copy(REPORT / "answers.jsonl.xz", tmp_path)

    @asynccontextmanager
    async def nobody() -> AsyncIterator[AsyncPlannerClient]:
        raise AssertionError("an answer is missing")
        yield

    suites = [suite(seed=0) for suite in SUITES.values()]
    asyncio.run(evaluate(suites, nobody, tmp_path, 1, Console(quiet=True)))
    for file in REPORT.rglob("*"):
        if file.suffix in {".md", ".html", ".tex", ".csv"}:
            assert (tmp_path / file.relative_to(REPORT)).read_text() == file.read_text(), file
