"""The same request with the same seed gives the plan that it gave before."""

import json
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from app.settings import SHIPPED_MODELS, Settings
from tests.recorded.requests import ANSWERS, Recorded, all_requests
from tests.served import serving, wait_until_ready

RECORDED = [
    (asked, json.loads(line))
    for asked, line in zip(all_requests(), ANSWERS.read_text().splitlines(), strict=True)
]


@pytest.fixture(scope="module")
def shipped() -> Iterator[httpx.Client]:
    """A service with the shipped models."""
    with serving(Settings(model_store=SHIPPED_MODELS)) as client:
        wait_until_ready(client)
        yield client


@pytest.mark.parametrize(("asked", "expected"), RECORDED)
def test_the_answer_is_the_one_on_record(
    asked: Recorded, expected: dict[str, Any], shipped: httpx.Client
) -> None:
    answer = shipped.post(asked.path, json=asked.request).raise_for_status().json()

    assert _without_what_varies(answer, asked) == pytest.approx(
        _without_what_varies(expected, asked), abs=asked.tolerance
    )


def _without_what_varies(answer: dict[str, Any], asked: Recorded) -> dict[str, Any]:
    """Return an answer's numbers by their place in it.

    Times vary; and how many rollouts refinement takes from a learned plan, by its last bits.
    """
    return {
        place: value
        for place, value in _leaves("", answer)
        if "/timing_ms/" not in place
        and not (place.endswith("/cost/rollouts") and "action_diffusion" in str(asked.request))
    }


def _leaves(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _leaves(f"{place}/{name}", part)
    elif isinstance(value, list):
        yield f"{place}/length", len(value)
        for index, part in enumerate(value):
            yield from _leaves(f"{place}/{index}", part)
    else:
        yield place, value
