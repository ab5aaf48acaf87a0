"""The playground in a real browser, against a real service with the shipped models."""

import csv
import io
import json
from contextlib import redirect_stdout
from pathlib import Path

import httpx
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from tests.api.playground.conftest import Open
from tests.browser import Visit, needs_chromium
from tests.metrics import value
from tests.served import wait_until

pytestmark = needs_chromium

TABS = {
    "plan": "Planned in",
    "compare": "Compared 4",
    "denoise": "Denoised 16 candidates in 20 steps",
    "doubt": "Judged on 256 plants",
    "loop": "Runs at 20 steps a second",
    "identify": "Identified from",
    "sequence": "Planned 3 segments",
}
SAMPLE = "log=sample.csv"
QUICK = "method=dataset_prior"
DRAWN = """() => [...document.querySelectorAll("canvas")].map((canvas) => {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return new Set(new Uint32Array(data.buffer)).size;
})"""
"""How many colours each chart has: axes alone have few, lines and areas many more."""


def shut_out(shown: Visit, options: dict[str, list[str]]) -> list[str]:
    """Return the rules of axe that are broken so that somebody cannot use the page."""
    found = Axe().run(shown.page, options=options).response["violations"]
    return [item["id"] for item in found if item["impact"] in ("serious", "critical")]


@pytest.mark.parametrize("tab", TABS)
def test_every_tab_shows_what_it_is_for_in_light_and_dark(visit: Open, tab: str) -> None:
    shown = visit(f"tab={tab}&{SAMPLE}")
    shown.says(TABS[tab])
    wait_until(lambda: all(colours > 20 for colours in shown.page.evaluate(DRAWN)))
    assert shown.page.locator(".legend").count() > 0
    shown.page.emulate_media(color_scheme="light")
    assert shut_out(shown, {"resultTypes": ["violations"]}) == []
    shown.page.emulate_media(color_scheme="dark")
    assert shut_out(shown, {"runOnly": ["color-contrast"]}) == []
    shown.is_quiet()


def test_no_tab_is_wider_than_a_phone(visit: Open) -> None:
    shown = visit(SAMPLE, width=360)
    for tab, words in TABS.items():
        shown.page.locator(f"#tab-{tab}").click()
        shown.says(words)
        assert shown.page.evaluate("document.documentElement.scrollWidth") <= 360
    shown.is_quiet()


def test_a_plan_is_what_the_service_answers_and_its_address_says_all(
    visit: Open, service: httpx.Client
) -> None:
    shown = visit()
    shown.says("Planned")
    shown.fill("Target position", "0.37")
    shown.page.get_by_label("Refine until it arrives").check()
    shown.fill("Seed", "11")
    expect(shown.page.locator(".verdict")).to_contain_text("this plan arrives")
    asked = {"initial_state": [0, 0], "target_state": [0.37, 0], "method": "dataset_prior"}
    plan = service.post("/plan", json=asked | {"refine": True, "seed": 11}).json()
    stuck = shown.page.locator(".measures div", has_text="Stuck steps").locator("dd")
    expect(stuck).to_have_text(str(plan["stuck_steps"]))

    wait_until(lambda: "seed=11" in shown.address)
    again = visit(shown.address)
    expect(again.page.get_by_label("Target position")).to_have_value("0.37")
    expect(again.page.locator(".measures div", has_text="Stuck steps").locator("dd")).to_have_text(
        str(plan["stuck_steps"])
    )
    shown.page.get_by_role("tab", name="Sequence").click()
    shown.says("Planned 3 segments")
    shown.page.go_back()
    shown.says("Planned in")
    shown.is_quiet()
    again.is_quiet()


def test_the_target_can_be_dragged_and_moved_by_keys(visit: Open) -> None:
    shown = visit()
    shown.says("Planned")
    handle = shown.page.get_by_role("button", name="target:")
    box = handle.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x - 60, y - 40, steps=4)
    assert "target=" not in shown.address
    shown.page.mouse.up()
    wait_until(lambda: "target=" in shown.address)
    position, velocity = shown.address.split("target=")[1].split("&")[0].split(",")
    assert float(position) < 0.6
    assert float(velocity) > 0
    shown.says("Planned")
    handle.focus()
    shown.page.keyboard.press("ArrowRight")
    wait_until(lambda: float(shown.address.split("target=")[1].split(",")[0]) > float(position))
    shown.is_quiet()


def test_a_target_out_of_reach_is_said_to_be_at_once(visit: Open) -> None:
    shown = visit(f"{QUICK}&target=3,0&refine=yes")
    expect(shown.page.locator(".verdict")).to_contain_text("cannot be reached in 64 steps (3.2 s)")
    expect(shown.page.locator(".verdict")).to_contain_text("the nearest that any plan ends is")
    shown.is_quiet()


def test_another_machine_has_its_own_units_and_frictions(visit: Open) -> None:
    shown = visit(f"{QUICK}&refine=yes")
    shown.says("Planned")
    shown.page.get_by_label("Preset").focus()
    shown.page.get_by_label("Preset").select_option("servo")
    expect(shown.page.get_by_label("Static friction", exact=True)).to_have_value("8.15")
    expect(shown.page.locator(".verdict")).to_contain_text("this plan arrives")
    expect(shown.page.locator("#field-machine")).to_be_focused()
    shown.page.get_by_text("Bias, gain, Stribeck, time step").click()
    shown.page.get_by_label("Friction differs by direction").check()
    shown.fill("Coulomb friction, backward", "2")
    shown.says("Planned")
    shown.page.get_by_role("button", name="Back to the preset").click()
    expect(shown.page.get_by_label("Coulomb friction", exact=True)).to_have_value("3.32")
    shown.is_quiet()


def test_the_mass_plays_pauses_and_is_scrubbed(visit: Open) -> None:
    shown = visit()
    shown.says("Planned")
    moment = shown.page.locator(".moment")
    expect(moment).to_contain_text("0.00 s")
    shown.page.get_by_role("button", name="Play").click()
    expect(moment).not_to_contain_text("0.00 s")
    shown.page.get_by_role("button", name="Pause").click()
    shown.page.get_by_label("Moment of the plan").fill("64")
    expect(moment).to_contain_text("3.20 s")
    wait_until(lambda: "moment=64" in shown.address)
    again = visit(shown.address)
    expect(again.page.locator(".moment")).to_contain_text("3.20 s")
    shown.is_quiet()
    again.is_quiet()


def test_a_slow_plan_says_so_and_can_be_cancelled(visit: Open, service: httpx.Client) -> None:
    def given_up() -> float:
        return value(service.get("/metrics").text, "breakaway_requests_total", status="499")

    before = given_up()
    slow = "method=cem&k=2000&horizon=1024&method.cem.iterations=500"
    shown = visit(slow)
    shown.says("Plan…")
    shown.page.get_by_role("button", name="Cancel").click()
    shown.says("Cancelled")
    wait_until(lambda: given_up() > before)
    shown.is_quiet()


def test_errors_stand_in_the_services_words_beside_their_field(visit: Open) -> None:
    shown = visit()
    shown.says("Planned")
    field = shown.page.get_by_label("Candidates K", exact=True)
    shown.fill("Candidates K", "0")
    error = shown.page.locator("#field-k-error")
    expect(error).to_have_text("Input should be greater than or equal to 1")
    expect(field).to_have_attribute("aria-invalid", "true")
    shown.fill("Candidates K", "8")
    shown.says("Planned")
    expect(error).to_be_empty()
    shown.fill("Coulomb friction", "0.9")
    expect(
        shown.page.get_by_text("coulomb_friction must not exceed static_friction")
    ).to_be_visible()
    shown.is_quiet(refusals=True)


def test_requests_are_offered_as_curl_and_python_and_plans_as_files(
    visit: Open, service: httpx.Client, tmp_path: Path
) -> None:
    shown = visit(f"{QUICK}&refine=yes&machine=emps&target=0.1,0")
    shown.says("Planned")
    with shown.page.expect_download() as csv_file:
        shown.page.get_by_role("button", name="Controls as CSV").click()
    csv_file.value.save_as(tmp_path / "controls.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "controls.csv").read_text())))
    with shown.page.expect_download() as json_file:
        shown.page.get_by_role("button", name="Plan as JSON").click()
    json_file.value.save_as(tmp_path / "plan.json")
    controls = json.loads((tmp_path / "plan.json").read_text())["controls"]
    assert [float(row["control"]) for row in rows[:-1]] == controls

    shown.page.get_by_text("The same request elsewhere").click()
    curl = shown.page.get_by_label("curl", exact=True).inner_text()
    body = curl.partition("-d '")[2].rstrip("'")
    assert service.post("/plan", json=json.loads(body)).json()["controls"] == controls
    written = io.StringIO()
    with redirect_stdout(written):
        exec(shown.page.get_by_label("Python", exact=True).inner_text(), {})
    assert json.loads(written.getvalue()) == controls
    shown.is_quiet()


def test_denoising_is_stepped_through(visit: Open) -> None:
    shown = visit("tab=denoise&stages=5&k=4")
    shown.says("Denoised 4 candidates in 5 steps")
    moment = shown.page.locator(".moment")
    shown.page.get_by_label("Denoising step", exact=True).fill("0")
    expect(moment).to_contain_text("Step 0 of 5: pure noise")
    shown.page.get_by_role("button", name="Play").click()
    expect(moment).to_contain_text("Step 5 of 5: the plans")
    shown.is_quiet()


def test_targets_are_added_and_their_segments_come_one_by_one(visit: Open) -> None:
    shown = visit(f"tab=sequence&{QUICK}&refine=yes")
    shown.says("Planned 3 segments")
    shown.page.get_by_role("button", name="Add a target").click()
    shown.says("Planned 4 segments")
    expect(shown.page.locator(".scroll tbody tr")).to_have_count(4)
    shown.page.get_by_role("button", name="Remove target 1").click()
    shown.says("Planned 3 segments")
    shown.is_quiet()
