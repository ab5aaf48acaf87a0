"""The playground where the service is busy, away, or asks for a key."""

from pathlib import Path

from playwright.sync_api import Browser, expect

from app.launch import free_port
from app.main import create_app
from app.settings import Settings
from tests.browser import Visit, needs_chromium
from tests.served import client_of, running, wait_until, wait_until_ready

pytestmark = needs_chromium

KEY = "a-key-for-the-laboratory"
QUICK = "method=dataset_prior&refine=yes"


def test_a_busy_service_is_asked_again(browser: Browser, tmp_path: Path) -> None:
    settings = Settings(model_store=tmp_path, max_pending_rollout_steps=1_000_000)
    with running(create_app(settings), settings=settings) as url, client_of(url) as client:
        wait_until_ready(client)
        shown = Visit(browser, url, "method=cem&k=512")
        shown.says("Asking again in 1 s")
        shown.says("simulated time steps would be pending")
        shown.fill("Candidates K", "16")
        shown.says("Planned")
        shown.is_quiet(refusals=True)


def test_a_service_that_goes_away_is_waited_for(browser: Browser, tmp_path: Path) -> None:
    settings, port = Settings(model_store=tmp_path), free_port()
    with running(create_app(settings), port, settings) as url, client_of(url) as client:
        wait_until_ready(client)
        shown = Visit(browser, url, QUICK)
        shown.says("Planned")
    shown.fill("Target position", "0.4")
    shown.says("the service cannot be reached. Asking again")
    with running(create_app(settings), port, settings):
        shown.says("Planned")
        expect(shown.page.locator(".verdict")).to_contain_text("this plan arrives")
        shown.is_quiet(refusals=True)


def steps_of(shown: Visit) -> int:
    return int(shown.page.locator(".counts").inner_text().split()[0])


def test_a_closed_loop_goes_on_where_a_service_left_it(browser: Browser, tmp_path: Path) -> None:
    settings, port = Settings(model_store=tmp_path), free_port()
    with running(create_app(settings), port, settings) as url, client_of(url) as client:
        wait_until_ready(client)
        shown = Visit(browser, url, "tab=loop&goal=0.02")
        arrived = shown.page.locator(".results tbody tr").first
        expect(arrived).to_contain_text("arrived")
    shown.says("the service cannot be reached. Asking again")
    steps = steps_of(shown)
    with running(create_app(settings), port, settings):
        shown.says("Runs at")
        wait_until(lambda: steps_of(shown) > steps + 5)
        expect(arrived).to_contain_text("arrived")
        shown.is_quiet(refusals=True)


def test_a_closed_loop_waits_for_room_and_needs_a_right_key(
    browser: Browser, tmp_path: Path
) -> None:
    settings = Settings(model_store=tmp_path, max_sessions=1, public_paths=("/*",))
    with running(create_app(settings), settings=settings) as url, client_of(url) as client:
        wait_until_ready(client)
        shown = Visit(browser, url, "tab=loop")
        shown.says("1 control sessions are open, as many as may be. Asking again")
        shown.is_quiet(refusals=True)
    private = Settings(
        model_store=tmp_path,
        api_keys=KEY,
        public_paths=("/", "/playground/*", "/readyz", "/machines", "/methods"),
    )
    with running(create_app(private), settings=private) as url, client_of(url) as client:
        wait_until_ready(client)
        shown = Visit(browser, url, "tab=loop")
        is_let_in_by_the_right_key_alone(shown, "Runs at")
        shown.is_quiet(refusals=True)


def is_let_in_by_the_right_key_alone(shown: Visit, then_says: str) -> None:
    refusal = shown.page.locator("#key-error")
    expect(refusal).to_have_text("send a valid key as Authorization: Bearer <key>")
    shown.fill("API key", "a-wrong-key-0123456789")
    expect(shown.page.get_by_label("API key")).to_have_attribute("aria-invalid", "true")
    shown.fill("API key", KEY)
    shown.says(then_says)
    expect(refusal).to_be_empty()


def test_a_key_is_asked_for_and_kept_in_memory_alone(browser: Browser, tmp_path: Path) -> None:
    settings = Settings(model_store=tmp_path, api_keys=KEY)
    with running(create_app(settings), settings=settings) as url, client_of(url) as client:
        client.headers["Authorization"] = f"Bearer {KEY}"
        wait_until_ready(client)
        shown = Visit(browser, url, QUICK)
        is_let_in_by_the_right_key_alone(shown, "Planned")
        shown.page.get_by_role("tab", name="Closed loop").click()
        shown.says("Runs at 20 steps a second")
        shown.page.get_by_text("The same request elsewhere").click()
        assert KEY not in shown.page.content()
        assert KEY not in shown.address
        kept = shown.page.evaluate("[...Object.entries(localStorage), document.cookie].join()")
        assert kept == ""
        shown.is_quiet(refusals=True)
