"""The OpenAPI page holds: whatever is sent, the answer is one that the page documents."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis.specs.openapi.checks import negative_data_rejection, positive_data_acceptance

from app.main import create_app
from app.settings import Settings
from tests.served import serving, wait_until_ready

CONTROLLERS = ["RecedingHorizon", "PD", "PID", "PDFeedforward", "TimeOptimalLaw", "Observer"]
KEY = "a-key-that-is-long-enough"
SMALL = Settings(
    max_candidates=64,
    max_rollout_steps=2_000_000,
    max_network_rows=5_000,
    admin=True,
    api_keys=KEY,
)
"""Room for small plans only, and every door that there is."""

page = schemathesis.openapi.from_dict(create_app(SMALL).openapi())


@pytest.fixture(scope="module")
def url(model_store: Path) -> Iterator[str]:
    with serving(SMALL.model_copy(update={"model_store": model_store})) as client:
        wait_until_ready(client)
        yield str(client.base_url)


@page.parametrize()
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
def test_every_answer_is_one_that_the_page_documents(
    case: schemathesis.Case[Any], url: str
) -> None:
    if isinstance(case.body, dict):
        deadline_ms = case.body.get("deadline_ms")
        if type(deadline_ms) is int and deadline_ms > 0:  # true is an int, and must stay refused
            # In time or not (504), that is up to the machine.
            case.body["deadline_ms"] = 300_000
    # A request may fit its schema and yet be too large, or fit no model: 422, as documented.
    excluded: list[Any] = [positive_data_acceptance]
    if case.path == "/plan_batch":  # one problem at fault is one line that says so
        excluded.append(negative_data_rejection)
    case.call_and_validate(
        base_url=url,
        headers={"Authorization": f"Bearer {KEY}"},
        excluded_checks=excluded,
    )


@pytest.mark.parametrize("options", [*CONTROLLERS, "ControlRequest"])
def test_every_option_of_a_controller_is_described(options: str) -> None:
    schema = create_app(SMALL).openapi()["components"]["schemas"][options]
    for name, field in schema["properties"].items():
        assert name == "name" or field["description"], name
