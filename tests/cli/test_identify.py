"""`breakaway identify` as a user runs it: files of every kind, and what is wrong with them."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import Result
from scipy.io import savemat

from app.evaluation.logs import Recording, draw_machine, record
from app.planning.plant.system import System
from app.wire.identification import IdentifyResponse
from tests.cli.command import invoke

RECORDING = Recording(num_steps=300)
LOG = record(RECORDING, draw_machine(RECORDING, 0, 0), 0, 0)
TIMES = LOG.time_step * np.arange(300)
TABLE = pd.DataFrame({"time": TIMES, "control": LOG.controls, "position": LOG.positions[:-1]})
Edit = Callable[[pd.DataFrame], pd.DataFrame]


def identify(folder: Path, *arguments: str) -> Result:
    files = ("--system", str(folder / "system.json"), "--picture", str(folder / "log.svg"))
    return invoke("identify", *arguments, *files, "--seed", "1")


def write_csv(folder: Path, table: pd.DataFrame) -> str:
    path = folder / "log.csv"
    table.to_csv(path, index=False)
    return str(path)


def system_of(folder: Path) -> System:
    return System(**json.loads((folder / "system.json").read_text())["system"])


def test_a_log_becomes_a_table_a_system_that_plans_take_and_a_picture(tmp_path: Path) -> None:
    log = write_csv(tmp_path, TABLE)
    answer = tmp_path / "answer.json"
    done = identify(tmp_path, log, "--known", '{"control_limit": 0.9}', "--json", str(answer))
    assert done.exit_code == 0, done.stderr
    whole = IdentifyResponse.model_validate_json(answer.read_bytes())
    assert "coulomb_friction" in done.stdout
    assert f"{whole.system.control_gain:.5g}" in done.stdout
    assert system_of(tmp_path) == whole.system
    assert (tmp_path / "log.svg").stat().st_size > 1000

    written = " ".join(done.stdout.split()).partition("Written: ")[2]
    for file in ("system.json", "log.svg", "answer.json"):
        assert str(tmp_path / file) in written
    assert f"--uncertainty {answer}" in written

    request = ("plan", "--request", str(tmp_path / "system.json"), "--target-state", "0.1", "0")
    plan = invoke(*request, "--method", "dataset_prior", "--refine", "--uncertainty", str(answer))
    assert plan.exit_code == 0, plan.stderr
    assert f"on {len(whole.systems)} plants" in plan.stdout


@pytest.mark.parametrize("ending", ["json", "mat", "csv"])
def test_units_and_names_are_the_files_own(tmp_path: Path, ending: str) -> None:
    columns = {"t_ms": 1e3 * TIMES, "volts": TABLE.control, "qm": 1e3 * TABLE.position}
    path = tmp_path / f"log.{ending}"
    match ending:
        case "json":
            path.write_text(
                json.dumps({name: np.array(values).tolist() for name, values in columns.items()})
            )
        case "mat":
            savemat(path, {name: np.array(values)[:, None] for name, values in columns.items()})
        case "csv":
            pd.DataFrame(columns).to_csv(path, index=False, sep=";")
    done = identify(tmp_path, str(path), "--control", "volts", "--position", "qm:mm")
    assert done.exit_code == 0, done.stderr
    assert system_of(tmp_path).control_gain == pytest.approx(1.0, abs=0.1)


def test_a_request_is_a_log_as_well(tmp_path: Path) -> None:
    path = tmp_path / "request.json"
    path.write_text(LOG.model_dump_json(exclude_none=True))
    done = identify(tmp_path, str(path), "--direction-dependent", "no", "--delay-steps", "0")
    assert done.exit_code == 0, done.stderr
    assert system_of(tmp_path).is_same_both_ways


def test_jittered_times_are_taken_at_even_ones_and_that_is_said(tmp_path: Path) -> None:
    jitter = 0.2 * LOG.time_step * np.random.default_rng(0).uniform(-1, 1, 300)
    done = identify(tmp_path, write_csv(tmp_path, TABLE.assign(time=TIMES + jitter)))
    assert done.exit_code == 0, done.stderr
    assert "at even ones" in " ".join(done.stdout.split())


def drop_rows(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(index=range(100, 150))


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (drop_rows, "a gap of"),
        (lambda table: table[::-1], "time runs backwards"),
        (lambda table: pd.concat([table, table]), "is it two logs in one?"),
        (lambda table: table.assign(time=TIMES**1.5), "too uneven"),
        (
            lambda table: table.assign(position=table.position.mask(table.index == 7)),
            "no finite numbers, the first in row 8",
        ),
        (lambda table: table.assign(position=0.5), "nothing moved"),
        (lambda table: table.assign(control=0.5), "0.5 throughout"),
        (lambda table: table.assign(position=1e3 * table.position), "another unit than m"),
        (
            lambda table: table.rename(columns={"position": "place"}),
            "no column is a position; there are time, control, place",
        ),
        (lambda table: table.rename(columns={"position": "position_ft"}), "the unit 'ft'"),
        (
            lambda table: table.drop(columns="time"),
            "no column has times; there are control, position",
        ),
        (lambda table: table.head(1), "no column has two values or more; there are time, control"),
        (lambda table: table.assign(time=1e3 * TIMES), "50 s lies beyond 1e-05 to 5 s: are times"),
        (
            lambda table: table.assign(velocity_mm=np.gradient(table.position, TIMES)),
            "the unit 'mm' is none of",
        ),
        (
            lambda table: table.assign(**{"velocity [mm/s]": np.gradient(table.position, TIMES)}),
            "both in the same unit",
        ),
    ],
)
def test_a_log_that_is_none_is_refused_in_words(tmp_path: Path, edit: Edit, reason: str) -> None:
    done = identify(tmp_path, write_csv(tmp_path, edit(TABLE)))
    assert done.exit_code == 1
    assert reason in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "system.json").exists()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--known", "{"), "--known: not JSON"),
        (("--known", '{"mass": 1}'), "--known /mass"),
        (("--delay-steps", "some"), "--delay-steps: must be a number, or auto"),
        (("--known", '{"control_limit": 0.5}'), "--known /control_limit: the log holds a control"),
        (("--control", "none"), "--control: "),
        (("--num-systems", "0"), "--num-systems"),
    ],
)
def test_an_option_at_fault_is_named(
    tmp_path: Path, arguments: tuple[str, ...], reason: str
) -> None:
    done = identify(tmp_path, write_csv(tmp_path, TABLE), *arguments)
    assert done.exit_code == 1
    assert reason in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("log.mat", b"no matrix", "cannot be read"),
        ("log.json", b"[1, 2]", "must be an object"),
        ("log.json", b"{", "cannot be read"),
        ("log.csv", b"", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused(
    tmp_path: Path, name: str, content: bytes, reason: str
) -> None:
    (tmp_path / name).write_bytes(content)
    done = identify(tmp_path, str(tmp_path / name))
    assert done.exit_code == 1
    assert reason in " ".join(done.stderr.split())


@pytest.mark.parametrize("text", ['{"system": {"control_limit": 2}}', '{"control_limit": 2}'])
def test_it_writes_controls_to_identify_a_machine_by(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rough.json"
    path.write_text(text)
    done = invoke("identify", "--excitation", str(path))
    assert done.exit_code == 0, done.stderr
    heading, *rows = done.stdout.splitlines()
    assert heading == "time_s,control"
    controls = np.array([float(row.split(",")[1]) for row in rows])
    assert np.abs(controls).max() <= 2
    assert controls.min() < 0 < controls.max()
    assert re.search(r"the mass goes from -?[\d.]+ to [\d.]+ m", done.stderr)


def test_controls_stay_within_a_stroke(tmp_path: Path) -> None:
    path = tmp_path / "rough.json"
    path.write_text('{"control_limit": 2}')
    within = ("identify", "--excitation", str(path), "--stroke")
    done = invoke(*within, "0.5")
    assert done.exit_code == 0, done.stderr
    assert len(done.stdout) < len(invoke(*within, "5").stdout)
    done = invoke(*within, "0.0001")
    assert done.exit_code == 1
    assert "--stroke: the shortest controls that tell anything take" in done.stderr
    assert invoke("identify", "log.csv", "--stroke", "1").exit_code == 2


def test_a_system_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rough.json"
    path.write_text('{"control_limit": -1}')
    done = invoke("identify", "--excitation", str(path))
    assert done.exit_code == 1
    assert "--excitation: control_limit" in done.stderr


def test_without_a_log_usage_is_shown() -> None:
    assert invoke("identify").exit_code == 2
