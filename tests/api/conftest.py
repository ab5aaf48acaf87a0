"""A running service over the tiny model: of one process, and of replicas in a cluster."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.launch import launch
from app.settings import Settings
from tests.served import client_of, serving, wait_until_ready

ON_RAY = pytest.param("ray", marks=pytest.mark.slow)


@pytest.fixture(scope="session", params=["process", ON_RAY])
def client(request: pytest.FixtureRequest, model_store: Path) -> Iterator[httpx.Client]:
    """A client of a ready service with default settings."""
    if request.param == "process":
        with serving(Settings(model_store=model_store)) as client:
            wait_until_ready(client)
            yield client
    else:
        pytest.importorskip("ray")
        arguments = ("tests.deploy.service", "--replicas", "2", "--model-store", str(model_store))
        with launch(*arguments) as service, client_of(service.url) as client:
            yield client
