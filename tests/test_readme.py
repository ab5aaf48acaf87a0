"""What the README shows is what a user gets."""

import json
import re
from pathlib import Path

import pytest

from app.api.schemas import PlanResponse
from app.planning.methods import METHODS
from app.settings import SHIPPED_MODELS, Settings
from tests.serving import serving, wait_until_ready

README = (Path(__file__).parents[1] / "README.md").read_text()


def test_the_request_shown_gets_the_answer_shown() -> None:
    request = json.loads(re.findall(r"-d '(\{.*?\})'", README, re.DOTALL)[0])
    shown = json.loads(re.findall(r"```json\n(.*?)```", README, re.DOTALL)[0])
    with serving(Settings(model_store=SHIPPED_MODELS)) as client:
        wait_until_ready(client)
        answer = client.post("/plan", json=request).json()
    PlanResponse.model_validate(answer)
    assert list(answer) == list(shown)
    for field in ("method", "model", "seed", "system", "cost"):
        assert answer[field] == shown[field]
    # The network's last bits differ between processors, and the plan with them.
    assert answer["terminal_error"] == pytest.approx(shown["terminal_error"], abs=5e-3)


def test_every_method_is_in_the_table() -> None:
    for method in METHODS:
        assert f"| `{method().name}` |" in README


def test_every_picture_shown_is_there() -> None:
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert pictures
    for picture in pictures:
        assert (SHIPPED_MODELS.parent / picture).is_file()
