"""A browser, and one service with the shipped models, for all that is looked at in a page."""

from collections.abc import Callable, Iterator

import httpx
import pytest
from playwright.sync_api import Browser

from app.settings import Settings
from tests.browser import Visit, chromium
from tests.served import serving, wait_until_ready

Open = Callable[..., Visit]


@pytest.fixture(scope="session")
def service() -> Iterator[httpx.Client]:
    with serving(Settings()) as client:
        wait_until_ready(client)
        yield client


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Ends with its file: while it lives, its event loop is in the way of every other one."""
    with chromium() as browser:
        yield browser


@pytest.fixture
def visit(service: httpx.Client, browser: Browser) -> Open:
    def visit(address: str = "method=dataset_prior", width: int = 1280) -> Visit:
        return Visit(browser, str(service.base_url).rstrip("/"), address, width)

    return visit
