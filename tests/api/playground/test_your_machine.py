"""A log is read by the page as by the command, identified by the service, and planned with."""

import math
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, expect

from app.cli import log_columns, log_file
from app.failure import Failure
from app.planning.identification.excitation import excitation
from app.planning.plant.system import System
from app.wire.identification import EXAMPLE_CONTROLS, EXAMPLE_POSITIONS
from tests.api.playground.conftest import Open
from tests.browser import Visit, needs_chromium
from tests.planning.identification.recordings import positions_between_samples

pytestmark = needs_chromium

LOG = "tab=identify"
READ = """async ([module, text, chosen, step]) => {
    const { columnsOf, readLog } = await import(module);
    try {
        const { fields, notes } = readLog(columnsOf(text), chosen, step ?? undefined);
        return { fields, notes };
    } catch (error) {
        return { complaint: error.message };
    }
}"""
TABLES = """async (module) => {
    const { ROLES, UNITS } = await import(module);
    return { ROLES, UNITS };
}"""
CONTROLS = [float(control) for control in EXAMPLE_CONTROLS]  # type: ignore[arg-type]
POSITIONS = [float(position) for position in EXAMPLE_POSITIONS]  # type: ignore[arg-type]
TIMES = [0.05 * k for k in range(len(POSITIONS))]


def text_of(heading: str, *columns: list[float], divider: str = ",") -> str:
    rows = [divider.join(f"{value:.10g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join([heading, *rows, ""])


MM = [1e3 * position for position in POSITIONS[: len(CONTROLS)]]
T = TIMES[: len(CONTROLS)]
PAIRS = [time + 0.045 * (k % 2) for k, time in enumerate(T)]
GOOD = text_of("time_s,control,position_mm", T, CONTROLS, MM)
JITTERED = [time + 0.004 * (k % 3) for k, time in enumerate(T)]
LOGS = {
    "millimetres": GOOD,
    "brackets": text_of("t [ms],u [V],x (mm)", [1e3 * t for t in T], CONTROLS, MM),
    "semicolons": "# a log\n" + text_of("Time; Force; Position", T, CONTROLS, MM, divider="; "),
    "tabs": text_of("timestamp\tcurrent_A\tangle_deg", T, CONTROLS, MM, divider="\t"),
    "velocities": text_of("time,u,p,v_mm/s", T, CONTROLS, MM, MM),
    "uneven": text_of("time,u,p", JITTERED, CONTROLS, MM),
    "no control": text_of("time,torque,p", T, CONTROLS, MM),
    "no position": text_of("time,u,pos_mm", T, CONTROLS, MM),
    "unknown unit": text_of("time,u,p_parsec", T, CONTROLS, MM),
    "a hole": GOOD.replace(",0.7,", ",,").replace("0.9,0.7", "0.9,n/a"),
    "backwards": text_of("time,u,p", T[::-1], CONTROLS, MM),
    "two logs": text_of("time,u,p", T[:40] + T[:-40], CONTROLS, MM),
    "a gap": text_of("time,u,p", T[:40] + [9 + t for t in T[40:]], CONTROLS, MM),
    "samples missing": text_of("time,u,p", PAIRS, CONTROLS, MM),
    "no times": text_of("u,p", CONTROLS, MM),
}


@pytest.fixture(scope="module")
def page(service: httpx.Client, browser: Browser) -> Iterator[Visit]:
    """A page whose modules are at hand."""
    shown = Visit(browser, str(service.base_url).rstrip("/"), LOG)
    shown.says("There is no log yet")
    yield shown
    shown.is_quiet()


def module(page: Visit, name: str) -> str:
    main: str = page.page.evaluate("document.querySelector('script').src")
    return main.replace("main.js", name)


def test_columns_are_called_as_the_command_calls_them(page: Visit) -> None:
    tables = page.page.evaluate(TABLES, module(page, "log/columns.js"))
    assert tables["ROLES"] == {role: list(names) for role, names in log_file.ROLES.items()}
    assert tables["UNITS"].keys() == log_columns.UNITS.keys()
    for role, units in log_columns.UNITS.items():
        assert tables["UNITS"][role] == pytest.approx(dict(units))


@pytest.mark.parametrize("name", LOGS)
def test_a_log_is_read_as_the_command_reads_it(page: Visit, tmp_path: Path, name: str) -> None:
    file = tmp_path / "log.csv"
    file.write_text(LOGS[name])
    read = page.page.evaluate(READ, [module(page, "log/read.js"), LOGS[name], {}, None])
    roles = dict.fromkeys(log_file.ROLES)
    try:
        expected = log_file.read_log(file, roles, None)
    except Failure as error:
        words = str(error).removeprefix(f"{file}: ")
        assert read["complaint"].partition("; choose")[0] == words.partition("; name")[0].replace(
            "name it with --time, or give --time-step", "choose one, or give the time step"
        )
        return
    assert tuple(read["notes"]) == expected.notes
    assert read["fields"].keys() == expected.fields.keys()
    for field, values in expected.fields.items():
        np.testing.assert_allclose(read["fields"][field], values, rtol=1e-9, atol=1e-12)


BROKEN = {
    "": "the file is empty",
    "\0\1\2": "the file is no text",
    "nothing\n1\n2\n": "the file has one column only",
    "time,u,p\n": "the file has no rows of numbers",
    "time,u,p\n0,1,2\n0,1,2,3\n": "row 2 has 4 values, where there are 3 columns",
    GOOD.replace(",0.9,", ",x,", 1): "control has 1 values that are no finite numbers",
    GOOD[:60]: "at least 30 items",
    text_of("t,u,p", T, CONTROLS, [0.1 for _ in T]): "the position is 0.1 throughout",
}


def test_a_broken_file_is_said_to_be_beside_its_field(visit: Open, tmp_path: Path) -> None:
    shown = visit(LOG)
    shown.says("There is no log yet")
    for index, (text, complaint) in enumerate(BROKEN.items()):
        file = tmp_path / f"broken-{index}.csv"
        file.write_text(text)
        shown.page.get_by_label("CSV file").set_input_files(file)
        error = shown.page.locator("#controls .error:not(:empty)").first
        expect(error).to_contain_text(complaint)
    expect(shown.page.get_by_role("button", name="Plan with it")).to_have_count(0)
    shown.is_quiet(refusals=True)


def test_a_machine_is_identified_and_planned_with(
    visit: Open, service: httpx.Client, tmp_path: Path
) -> None:
    file = tmp_path / "axis.csv"
    file.write_text(text_of("time_s,torque,position_mm", T, CONTROLS, MM))
    shown = visit(LOG)
    shown.page.get_by_label("CSV file").set_input_files(file)
    expect(shown.page.locator("#field-log\\.control-error")).to_have_text(
        "no column is a control; there are time_s, torque, position_mm; choose one"
    )
    shown.page.get_by_label("Control", exact=True).select_option("torque")
    shown.fill("Control limit", "0.9")
    shown.says("Identified from 76 samples")
    asked = {
        "time_step": 0.05,
        "controls": CONTROLS,
        "positions": [1e-3 * position for position in MM],
        "known": {"control_limit": 0.9},
        "seed": 7,
    }
    answer = service.post("/identify", json=asked).json()
    explained = math.floor(1e4 * answer["fit"]["r2"]) / 100
    expect(shown.page.locator(".verdict")).to_contain_text(
        f"which explains {explained:.2f} % of the motion"
    )
    rows = shown.page.locator(".results tbody tr")
    expect(rows).to_have_count(len(answer["parameters"]))
    texts = rows.locator("td:nth-child(2)").all_inner_texts()[:4]
    expected = [parameter["value"] for parameter in answer["parameters"]][:4]
    np.testing.assert_allclose([float(text) for text in texts], expected, rtol=1e-3)
    for words in [*answer["warnings"], *(text.replace("`", "") for text in answer["advice"])]:
        expect(shown.page.get_by_text(words, exact=True)).to_be_visible()

    shown.page.get_by_role("button", name="Plan with it").click()
    shown.says("Planned in")
    expect(shown.page.locator(".verdict")).to_contain_text("plants that it may be this plan ends")
    expect(shown.page.get_by_label("Preset")).to_have_value("own")
    coulomb = float(shown.page.get_by_label("Coulomb friction", exact=True).input_value())
    assert coulomb == pytest.approx(answer["system"]["coulomb_friction"], rel=1e-4)
    verdict = shown.page.locator(".verdict").inner_text()
    again = visit(shown.address)
    again.says("Planned in")
    expect(again.page.locator(".verdict")).to_have_text(verdict)
    again.is_quiet()
    shown.page.go_back()
    shown.says("Identified from 76 samples")
    shown.is_quiet()


def test_a_machine_that_moves_between_its_samples_is_said_to(visit: Open, tmp_path: Path) -> None:
    axis = System(1.28, 1.02, 0.4, control_gain=0.45, control_limit=8.0, time_step=0.02)
    controls = excitation(axis)
    positions = positions_between_samples(axis, controls)
    times = [axis.time_step * k for k in range(len(controls))]
    file = tmp_path / "axis.csv"
    file.write_text(text_of("time,u,position", times, controls.tolist(), positions[:-1].tolist()))
    shown = visit(LOG)

    shown.page.get_by_label("CSV file").set_input_files(file)

    shown.says("Identified from")
    expect(shown.page.locator(".verdict")).to_contain_text("a position_lag of 0.01 s")
    shown.is_quiet()


def test_columns_are_recognised_by_the_names_that_are_shown(visit: Open, tmp_path: Path) -> None:
    shown = visit(LOG)
    shown.says("There is no log yet")
    heading = shown.page.locator(".invitation code").inner_text()
    file = tmp_path / "axis.csv"
    file.write_text(text_of(heading, T, CONTROLS, MM))
    shown.page.get_by_label("CSV file").set_input_files(file)
    shown.says("Identified from 76 samples")
    position = shown.page.get_by_label("Position", exact=True)
    expect(position.locator("option:checked")).to_have_text("position_mm (by name)")
    shown.is_quiet()


DROP = """([name, text]) => {
    const files = new DataTransfer();
    files.items.add(new File([text], name));
    const drop = new DragEvent("drop", { dataTransfer: files, bubbles: true, cancelable: true });
    document.querySelector(".drop").dispatchEvent(drop);
}"""


def test_a_file_is_dropped_and_asked_for_again_by_its_address(visit: Open) -> None:
    shown = visit(LOG)
    shown.says("There is no log yet")
    shown.page.evaluate(DROP, ["axis.csv", text_of("u,p", CONTROLS, MM)])
    expect(shown.page.locator("#field-log\\.time-error")).to_contain_text("no column has times")
    shown.page.get_by_label("Unit of position").select_option("mm")
    shown.fill("Time step, s", "0.05")
    shown.says("Identified from 76 samples")
    again = visit(shown.address)
    expect(again.page.locator("#log-error")).to_contain_text("choose axis.csv again")
    expect(again.page.get_by_label("Time step, s")).to_have_value("0.05")
    again.is_quiet()
    shown.is_quiet()
