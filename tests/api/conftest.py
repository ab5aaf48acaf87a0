"""A running service over the tiny model."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.settings import Settings
from tests.served import serving, wait_until_ready


@pytest.fixture(scope="session")
def client(model_store: Path) -> Iterator[httpx.Client]:
    """A client of a ready service with default settings."""
    with serving(Settings(model_store=model_store)) as client:
        wait_until_ready(client)
        yield client
