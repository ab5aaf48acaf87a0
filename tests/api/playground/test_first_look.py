"""What the page tells somebody who sees it for the first time, on a desk and on a phone."""

import httpx
import numpy as np
from playwright.sync_api import expect

from tests.api.playground.conftest import Open
from tests.browser import Visit, needs_chromium

pytestmark = needs_chromium

QUICK = "method=dataset_prior&refine=yes"
QUESTIONS = (
    "What is this?",
    "Why does a small push do nothing?",
    "What is the floor?",
    "Which method?",
    "Can my machine do this move?",
    "And if its friction is not quite known?",
)
PHONE = 390
RANGES = """async ([module, ranges]) => {
    const { around } = await import(module);
    return ranges.map((range) => around(...range));
}"""
SPARE = """() => [...document.querySelectorAll(".column-row select")].map((select) => {
    const pen = document.createElement("canvas").getContext("2d");
    const { fontSize, fontFamily } = getComputedStyle(select);
    pen.font = `${fontSize} ${fontFamily}`;
    const arrow = 34;
    return select.clientWidth - arrow - pen.measureText(select.selectedOptions[0].text).width;
})"""
"""What is left of each field beside its text, pixels."""


def verdict(shown: Visit) -> str:
    shown.says("Planned in")
    return shown.page.locator(".verdict").inner_text()


def test_the_page_answers_what_is_asked_first(visit: Open) -> None:
    shown = visit(f"{QUICK}&machine=emps&target=0.3,0")
    expect(shown.page.locator(".verdict")).to_contain_text("this plan arrives")
    for question in QUESTIONS:
        expect(shown.page.get_by_text(question, exact=True)).to_be_visible()
    held = shown.page.locator(".notes div", has_text="a small push")
    expect(held).to_contain_text(
        "any push between \N{MINUS SIGN}0.704 and 0.688 V. Only a stronger one"
    )
    shown.is_quiet()


def test_steps_are_said_with_the_time_that_they_take(visit: Open, service: httpx.Client) -> None:
    task = {"initial_state": [0, 0], "target_state": [0.3, 0], "system": "emps"}
    plan = service.post("/plan", json=task | {"method": "dataset_prior", "refine": True}).json()
    steps = plan["reachability"]["minimum_steps"]
    seconds = f"{0.01 * steps:.3g} of 0.64 s"
    shown = visit(f"{QUICK}&machine=emps&target=0.3,0")
    assert f"can be reached in {steps} of the 64 steps ({seconds})" in verdict(shown)
    shown.is_quiet()


def test_out_of_reach_it_says_where_the_nearest_plan_ends(
    visit: Open, service: httpx.Client
) -> None:
    task = {"initial_state": [0, 0], "target_state": [2, 0], "method": "dataset_prior"}
    reach = service.post("/plan", json=task | {"refine": True}).json()["reachability"]
    position, velocity = reach["nearest_state"]
    shown = visit(f"{QUICK}&target=2,0")
    text = verdict(shown)
    assert f"the nearest that any plan ends is {position:.3g} m at {velocity:.2g} m/s" in text
    assert f"an error of {1e3 * reach['floor']:.0f} mm (the floor)" in text
    assert "More steps, a higher limit or another target would help" in text
    shown.is_quiet()


def test_what_no_push_moves_is_not_promised_to_move(visit: Open) -> None:
    shown = visit(f"{QUICK}&target=0.2,0&system.control_limit=0.65")
    assert "a higher limit would help, more steps would not" in verdict(shown)
    held = shown.page.locator(".notes div", has_text="a small push")
    expect(held).to_contain_text("it never moves.")
    expect(held).not_to_contain_text("what slides")
    shown.is_quiet()


def test_axes_of_what_does_not_move_are_no_noise(visit: Open) -> None:
    shown = visit("tab=identify")
    shown.says("There is no log yet")
    module = shown.page.evaluate("document.querySelector('script').src")
    ranges = [[0, 0], [0.6, 0.6], [0, 1e-12], [-1, 1, 0.1]]
    found = shown.page.evaluate(RANGES, [module.replace("main", "charts/chart"), ranges])
    expected = [[-0.5, 0.5], [0.3, 0.9], [-0.5, 0.5], [-1.2, 1.2]]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    shown.is_quiet()


def test_a_comparison_says_which_to_take(visit: Open) -> None:
    shown = visit("tab=compare&compare=uniform,dataset_prior%2B")
    shown.says("Compared 2")
    words = shown.page.locator(".verdict")
    expect(words).to_contain_text("The quickest without a gap: dataset prior, refined, in")
    shown.page.get_by_label("dataset prior, refined", exact=True).uncheck()
    expect(words).to_contain_text("All have a gap; the least has uniform: ")
    shown.fill("Target position", "2")
    expect(words).to_contain_text("The target cannot be reached: no method ends nearer than 696 mm")
    shown.is_quiet()


def test_doubt_does_not_promise_what_is_out_of_reach(visit: Open) -> None:
    shown = visit("tab=doubt&method=dataset_prior&target=2,0")
    shown.says("Judged on 256 plants")
    words = shown.page.locator(".verdict")
    expect(words).to_contain_text("no plan ends nearer than 696 mm (the floor)")
    expect(words).not_to_contain_text("feedback")
    shown.is_quiet()


def test_fields_of_a_log_show_all_of_their_words(visit: Open) -> None:
    shown = visit("tab=identify")
    shown.says("There is no log yet")
    spare = shown.page.evaluate(SPARE)
    assert min(spare) >= 0, spare
    shown.is_quiet()


def test_a_phone_shows_the_way_to_the_form_and_numbers_on_every_track(visit: Open) -> None:
    shown = visit(QUICK, width=PHONE)
    for tab, words in {"plan": "Planned in", "sequence": "Planned 3", "loop": "Runs at"}.items():
        shown.page.locator(f"#tab-{tab}").click()
        shown.says(words)
        expect(shown.page.locator(".ticks text").nth(2)).to_be_attached()
    field = shown.page.get_by_label("Go to", exact=True)
    expect(field).not_to_be_in_viewport()
    shown.page.get_by_role("button", name="Change what is asked").click()
    expect(field).to_be_in_viewport()
    shown.is_quiet()
    wide = visit(QUICK)
    expect(wide.page.get_by_role("button", name="Change what is asked")).to_be_hidden()
    wide.is_quiet()
