"""A real browser for tests of the playground: the system's Chromium, without a window."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((path for name in NAMES if (path := shutil.which(name))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
PATIENCE_MS = 30_000
"""For what a page expects: many times what it takes, for machines that do much else."""
REFUSED = "Failed to load resource", "WebSocket connection to"
"""What Chromium says of every answer that is an error, and of every one that does not come."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Chromium; pages wait for what they expect as long as a loaded machine takes."""
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        # As root, in a container, there is no sandbox; small /dev/shm there as well.
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-dev-shm-usage"]
        )
        yield browser
        browser.close()


class Visit:
    """A page of its own, and all that its console said.

    Args:
        browser: that shows it.
        url: of the service.
        address: what follows `#`: the state of the page.
        width: of the window, pixels.
    """

    def __init__(self, browser: Browser, url: str, address: str = "", width: int = 1280) -> None:
        self.url = url
        self.complaints: list[str] = []
        self.page: Page = browser.new_page(viewport={"width": width, "height": 900})
        self.page.set_default_timeout(PATIENCE_MS)
        self.page.on("console", self._listen)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(f"{url}/#{address}")

    def _listen(self, message: ConsoleMessage) -> None:
        self.complaints.append(f"{message.type}: {message.text}")

    @property
    def address(self) -> str:
        """What follows `#` now; the driver's own notion of it comes later."""
        return str(self.page.evaluate("location.hash.slice(1)"))

    def says(self, words: str) -> None:
        """Wait until the status line has these words."""
        expect(self.page.get_by_role("status").first).to_contain_text(words)

    def fill(self, label: str, text: str) -> None:
        """Type into a field and leave it."""
        field = self.page.get_by_label(label, exact=True)
        field.fill(text)
        field.blur()

    def is_quiet(self, *, refusals: bool = False) -> None:
        """Close the page; its console must have said nothing, but that something was refused."""
        self.page.close()
        told = REFUSED if refusals else ()
        loud = [text for text in self.complaints if not any(words in text for words in told)]
        assert loud == [], loud
