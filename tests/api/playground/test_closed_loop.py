"""The live loop: the machine in the page, what hands do to it, and what becomes of sessions."""

import io
import json
from collections.abc import Iterator
from contextlib import redirect_stdout
from typing import Any

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, expect
from pydantic import TypeAdapter

from app.planning.plant.machines import MACHINES
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System
from tests.api.playground.conftest import Open
from tests.browser import Visit, needs_chromium
from tests.metrics import value
from tests.served import wait_until

pytestmark = needs_chromium

LOOP = "tab=loop&goal=0.05"
ROLL_OUT = """async ([module, system, state, controls]) => {
    const { takeStep } = await import(module);
    const states = [state];
    for (const control of controls) states.push(takeStep(system, states.at(-1), control));
    return states;
}"""
PLANTS = {name: machine.system for name, machine in MACHINES.items()} | {
    "uneven": System(ByDirection(0.7, 0.5), ByDirection(0.5, 0.4), ByDirection(0.1, 1.0), bias=0.1),
    "weakening": System(0.8, 0.4, 0.2, stribeck_velocity=0.05, bias=-0.1, control_gain=2.0),
    "frictionless": System(0.0, 0.0, 0.0),
}


@pytest.mark.parametrize("name", PLANTS)
def test_the_machine_in_the_page_moves_as_those_of_the_service(
    page: Visit, service: httpx.Client, name: str
) -> None:
    system = PLANTS[name]
    plant = system.plant
    draw = np.random.default_rng(7)
    controls = np.repeat(draw.uniform(plant.lowest_control, plant.highest_control, 60), 4)
    machines = {one["name"]: one["system"] for one in service.get("/machines").json()}
    asked = {"initial_state": [0.1, -0.02], "controls": controls.tolist()}
    fields = service.post("/simulate", json=asked | {"system": system_fields(system)}).json()
    assert name not in machines or fields["system"] == machines[name]
    module = page.page.evaluate("document.querySelector('script').src").replace("main", "plant")
    found = page.page.evaluate(
        ROLL_OUT, [module, fields["system"], asked["initial_state"], asked["controls"]]
    )
    expected = rollout(system, np.array(asked["initial_state"]), controls[np.newaxis])[0]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)
    assert np.ptp(expected[:, 0]) > 1e-4
    assert np.any(expected[1:, 1] == 0.0) or name == "frictionless"


def system_fields(system: System) -> dict[str, Any]:
    fields: dict[str, Any] = TypeAdapter(System).dump_python(system, mode="json")
    return fields


@pytest.fixture(scope="module")
def page(service: httpx.Client, browser: Browser) -> Iterator[Visit]:
    """A page whose modules are at hand."""
    shown = Visit(browser, str(service.base_url).rstrip("/"), "tab=identify")
    shown.says("There is no log yet")
    yield shown
    shown.is_quiet()


def first(shown: Visit) -> Locator:
    return shown.page.locator(".results tbody tr").first


def error_mm(shown: Visit) -> float:
    text = first(shown).locator("td").nth(1).inner_text()
    number, unit = text.split() if " " in text else ("nan", "m")
    return float(number) * {"mm": 1.0, "µm": 1e-3, "m": 1e3}[unit]


def sessions(service: httpx.Client) -> float:
    return value(service.get("/metrics").text, "breakaway_control_sessions")


def test_a_mass_that_is_pulled_away_comes_back(visit: Open, service: httpx.Client) -> None:
    shown = visit("tab=loop&goal=0")
    expect(first(shown)).to_contain_text("arrived")
    box = shown.page.locator(".machine").first.bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x - 200, y, steps=4)
    wait_until(lambda: error_mm(shown) > 20.0)
    shown.page.mouse.up()
    wait_until(lambda: error_mm(shown) < 2.0)
    assert sessions(service) == 2
    shown.page.get_by_role("tab", name="Plan", exact=True).click()
    wait_until(lambda: sessions(service) == 0)
    shown.is_quiet()


def test_masses_are_pushed_and_sent_elsewhere_by_keys(visit: Open) -> None:
    shown = visit(LOOP)
    expect(first(shown)).to_contain_text("arrived")
    shown.page.get_by_role("button", name="Push both masses forward").focus()
    shown.page.keyboard.down("Space")
    wait_until(lambda: error_mm(shown) > 5.0)
    shown.page.keyboard.up("Space")
    wait_until(lambda: error_mm(shown) < 2.0)
    shown.page.get_by_role("button", name="To the other side").press("Enter")
    wait_until(lambda: "goal=-0.05" in shown.address)
    wait_until(lambda: error_mm(shown) > 50.0)
    wait_until(lambda: error_mm(shown) < 2.0)
    shown.page.locator(".tracks").click(position={"x": 60, "y": 60})
    wait_until(lambda: float(shown.address.split("goal=")[1].split("&")[0]) < -0.1)
    shown.is_quiet()


def test_the_machine_changes_while_it_runs_and_its_address_says_how(
    visit: Open, service: httpx.Client
) -> None:
    def opened() -> float:
        labels = {"http_method": "WEBSOCKET", "status": "101"}
        return value(service.get("/metrics").text, "breakaway_requests_total", **labels)

    shown = visit(LOOP)
    expect(first(shown)).to_contain_text("arrived")
    ended = opened()
    shown.fill("Coulomb friction, %", "-30")
    shown.fill("Bias, m/s²", "0.05")
    shown.page.get_by_role("button", name="To the other side").click()
    wait_until(lambda: error_mm(shown) > 50.0)
    wait_until(lambda: error_mm(shown) < 2.0)
    assert opened() == ended
    shown.fill("Delay, steps", "2")
    shown.fill("Sensor noise, mm", "1")
    wait_until(lambda: opened() >= ended + 2)
    shown.says("Runs at")
    wait_until(lambda: "noise=1" in shown.address)
    again = visit(shown.address)
    expect(again.page.get_by_label("Coulomb friction, %", exact=True)).to_have_value("-30")
    expect(again.page.get_by_label("Delay, steps", exact=True)).to_have_value("2")
    again.says("Runs at")
    again.page.get_by_role("button", name="Halt").click()
    again.says("Halted")
    wait_until(lambda: sessions(service) == 2)
    again.page.get_by_role("button", name="Go on").click()
    again.says("Runs at")
    shown.is_quiet()
    again.is_quiet()


def test_what_cannot_be_is_said_beside_its_field(visit: Open) -> None:
    shown = visit("tab=loop&goal=1e9")
    expect(shown.page.locator("#field-goal-error")).to_have_text(
        "Input should be less than or equal to 1000000"
    )
    shown.fill("Go to", "0.02")
    shown.says("Runs at")
    shown.fill("Static friction", "5")
    shown.page.get_by_role("button", name="To the other side").click()
    expect(first(shown)).to_contain_text("cannot get there")
    shown.is_quiet()


def test_a_run_of_the_same_is_offered_elsewhere(visit: Open, service: httpx.Client) -> None:
    shown = visit(f"{LOOP}&noise=0&off.bias=0.02")
    shown.says("Runs at")
    shown.page.get_by_text("The same request elsewhere").click()
    curl = shown.page.get_by_label("curl", exact=True).inner_text()
    run = service.post("/simulate", json=json.loads(curl.partition("-d '")[2].rstrip("'"))).json()
    assert run["system"]["coulomb_friction"] == pytest.approx(1.12 * 0.6)
    assert run["system"]["bias"] == pytest.approx(0.02)
    assert run["runs"][0]["final_error"] < 2e-3
    written = io.StringIO()
    with redirect_stdout(written):
        exec(shown.page.get_by_label("Python", exact=True).inner_text(), {})
    assert eval(written.getvalue()) == tuple(run["runs"][0]["final_state"])
    shown.is_quiet()


def test_a_fast_machine_is_shown_in_slow_motion(visit: Open) -> None:
    shown = visit("tab=loop&machine=servo&goal=0.05")
    shown.says("Runs at 50 steps a second, 4 times slower than the machine is")
    expect(first(shown)).to_contain_text("arrived")
    shown.is_quiet()
