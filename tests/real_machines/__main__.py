"""`python -m tests.real_machines FILE...`: EMPS identified from its records.

Janot, Gautier and Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear System
Identification Benchmarks, 2019. The files DATA_EMPS.mat (from which it is identified) and
DATA_EMPS_PULSES.mat are not ours to ship.
"""

import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.io import loadmat
from tabulate import tabulate

from app.planning.arrays import FloatArray
from app.planning.identification.identify import Question, identify
from app.planning.identification.log import Log
from app.planning.identification.log_checks import checked_log
from app.planning.plant.rollout import rollout_on
from app.planning.plant.system import ByDirection, System

TIME_STEP, LIMIT = 1e-3, 10.0
MASS, VOLTS = 95.154, 35.15065
"""kg and N/V, published."""
PUBLISHED = System(
    static_friction=ByDirection(20.144 / MASS, 20.628 / MASS),
    coulomb_friction=ByDirection(20.144 / MASS, 20.628 / MASS),
    viscous_damping=ByDirection(166.706 / MASS, 240.424 / MASS),
    control_gain=VOLTS / MASS,
    control_limit=LIMIT,
    time_step=TIME_STEP,
)
"""The direction-dependent model; it has no static friction and no offset."""
WINDOW = 500
SMOOTHED = 11
"""Samples over which the velocity at the start of a window is a mean."""


def main(files: list[Path]) -> None:
    """Identify from the first file, and predict all of them."""
    records = {file.name: read(file) for file in files}
    log = next(iter(records.values()))
    began = perf_counter()
    found = identify(log, Question({"control_limit": LIMIT}), np.random.default_rng(0))
    seconds = perf_counter() - began
    rows = []
    for parameter in found.parameters:
        field, _, way = parameter.name.partition(".")
        value = getattr(PUBLISHED, field)
        published = getattr(value, way) if way else value
        off = f"{100 * (parameter.value / published - 1):+.1f} %" if published else ""
        low, high = parameter.interval
        rows.append(
            [
                parameter.name,
                f"{parameter.value:.4f}",
                f"{low:.4f} to {high:.4f}",
                f"{published:.4f}" if field != "static_friction" else "",
                off if field != "static_friction" else "",
                parameter.why_not or "",
            ]
        )
    print(f"{found.delay_steps} steps of delay, {seconds:.1f} s; {'; '.join(found.warnings)}")
    print(tabulate(rows, ("parameter", "found", "95 %", "published", "off by", "why not")))
    errors = [
        [name, *(f"{1e3 * end_error(s, record):.3f}" for s in (found.system, PUBLISHED))]
        for name, record in records.items()
    ]
    print(f"\nEnd position after {WINDOW * TIME_STEP:g} s, r.m.s. error (mm)")
    print(tabulate(errors, ("record", "found", "published")))


def read(file: Path) -> Log:
    """Return a record: drive voltage (V) and measured position (m)."""
    content = loadmat(str(file))
    return checked_log(TIME_STEP, content["vir"][:, 0], content["qm"][:, 0])


def end_error(system: System, log: Log) -> float:
    """Return the r.m.s. error of predictions from measured states, open loop, m."""
    starts = np.arange(0, log.num_steps - WINDOW, WINDOW)
    slopes = np.gradient(log.positions, TIME_STEP)
    means = np.convolve(slopes, np.full(SMOOTHED, 1.0 / SMOOTHED), "same")
    states: FloatArray = np.column_stack([log.positions[starts], means[starts]])
    controls = log.controls[starts[:, np.newaxis] + np.arange(WINDOW)]
    ends = rollout_on(system.plant, states, controls)[:, -1, 0]
    return float(np.sqrt(np.mean((ends - log.positions[starts + WINDOW]) ** 2)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit((__doc__ or "").splitlines()[0])
    main([Path(name) for name in sys.argv[1:]])
