"""Whole runs of a controller, or of a control sequence, on a true plant unlike its model.

Many seeds at once; what a run is worth is measured in runs.py.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike

from app.planning.arrays import FloatArray
from app.planning.control.base import Controller
from app.planning.control.memory import MAX_PLAN, PLAN_LENGTH, Memory
from app.planning.control.observer import Noise
from app.planning.control.runs import Runs
from app.planning.control.settings import SEQUENCE, Settings
from app.planning.control.stepping import Machine, Record, run
from app.planning.options import Options
from app.planning.plant.system import LARGEST, Plant, System
from app.planning.problem import as_state
from app.planning.stop import NEVER, Stop
from app.planning.uncertainty.ensemble import NO_PLANTS, Ensemble

MAX_STEPS = 100_000
Acceleration: TypeAlias = Annotated[float, Ge(-LARGEST), Le(LARGEST)]
Count: TypeAlias = Annotated[int, Ge(1), Le(MAX_STEPS)]


@dataclass(frozen=True, slots=True)
class Pulse(Options):
    """A force that pushes the mass for a while."""

    first_step: Annotated[int, Ge(0), Le(MAX_STEPS)]
    """The step in which it begins, from 0 on."""
    steps: Count
    """How long it lasts."""
    acceleration: Acceleration
    """m/s^2."""


@dataclass(frozen=True, slots=True)
class Disturbance(Options):
    """Forces that no controller is told of."""

    acceleration_noise: Noise = 0.0
    """m/s^2, the standard deviation; drawn anew for each step."""
    pulses: tuple[Pulse, ...] = ()


@dataclass(frozen=True, slots=True)
class Sensor(Options):
    """What is measured of the true state, and how well."""

    position_noise: Noise = 0.0
    """m, the standard deviation."""
    velocity_noise: Noise = 0.0
    """m/s, the standard deviation."""
    position_step: Noise = 0.0
    """m: the resolution of an encoder, to whose multiples positions are rounded; 0 for none."""
    measures_velocity: bool = True
    """Whether velocities are measured, or positions alone."""
    position_lag: Noise = 0.0
    """s: positions are those of so long ago, at the velocity of now; half a time step is what a
    machine shows whose control is held from sample to sample."""


@dataclass(frozen=True, slots=True)
class TrueMachine:
    """What a run is made on, whatever its controller believes."""

    system: System = field(default_factory=System)
    disturbance: Disturbance = field(default_factory=Disturbance)
    sensor: Sensor = field(default_factory=Sensor)
    delay_steps: int = 0
    """Time steps that a control takes to the actuator."""


@dataclass(frozen=True, slots=True)
class ToldOf:
    """What the controller of a run knows of the machine, and is asked for."""

    model: System
    """What is believed of the plant."""
    target_position: float
    """m; the mass is to rest there."""
    deadline: int | None = None
    """Steps until it has to; as early as possible without one."""
    of_delay: bool = True
    """Whether the controls that are on their way are known."""


@dataclass(frozen=True, slots=True)
class Controls:
    """Open loop: a control sequence, and then what keeps the mass at rest."""

    controls: FloatArray
    """(H,), of at most 1024 steps."""
    name: str = "controls"
    observer: None = None

    def settings(self, model: Plant) -> Settings:
        return Settings(SEQUENCE, rest_velocity=model.velocity_threshold)


def simulate(
    machine: TrueMachine,
    initial_state: ArrayLike,
    controller: Controller | Controls,
    told: ToldOf,
    steps: int,
    seeds: Iterable[int],
    *,
    ensemble: Ensemble | None = None,
    stop: Stop = NEVER,
) -> Runs:
    """Run a controller on a machine, once for each seed.

    Seeds alone decide disturbances and noise: with the same ones, all controllers meet the same.

    Args:
        machine: the true one.
        initial_state: (2,), m and m/s.
        controller: with its options; or controls for an open loop.
        told: what the controller knows and is asked for.
        steps: T.
        seeds: of the runs.
        ensemble: as for a step.
        stop: ends it early.

    Raises:
        ValueError: the model and the machine differ in time step or limits; the controls are too
            many; velocities are not measured, and no observer is there to estimate them.
        Stopped: `stop` said so.
    """
    model = told.model.plant
    _check(machine, controller, told)
    settings = controller.settings(model)
    start = as_state(initial_state)
    states, measurements, controls, statuses, estimates = [], [], [], [], []
    for seed in seeds:
        drawn = _draw(machine, steps, np.random.default_rng(seed))
        memory = Memory.empty()
        if isinstance(controller, Controls):
            memory.plan[: controller.controls.size] = controller.controls
            memory.registers[PLAN_LENGTH] = controller.controls.size
        record = Record.begun(start, steps)
        run(
            np.full(machine.delay_steps, 0.0),
            told.of_delay,
            float(told.target_position),
            -1 if told.deadline is None else told.deadline,
            model,
            settings,
            memory,
            NO_PLANTS if ensemble is None else ensemble.plants,
            drawn,
            record,
            stop.flag,
        )
        stop.check()
        states.append(record.states)
        measurements.append(record.measurements)
        estimates.append(record.estimates)
        controls.append(record.controls)
        statuses.append(record.statuses)
    return Runs(
        machine.system,
        float(told.target_position),
        np.array(states),
        np.array(measurements),
        np.array(estimates),
        np.array(controls),
        np.array(statuses),
    )


def _check(machine: TrueMachine, controller: Controller | Controls, told: ToldOf) -> None:
    truth, model = machine.system.plant, told.model.plant
    if truth.time_step != model.time_step:
        raise ValueError("the model must have the machine's time_step")
    if (truth.lowest_control, truth.highest_control) != (
        model.lowest_control,
        model.highest_control,
    ):
        raise ValueError("the model must have the machine's control_limit")
    if isinstance(controller, Controls):
        if controller.controls.size > MAX_PLAN:
            raise ValueError(f"controls has more than {MAX_PLAN} steps")
    elif controller.observer is None and not machine.sensor.measures_velocity:
        raise ValueError("without velocities a controller needs an observer")


def _draw(machine: TrueMachine, steps: int, rng: np.random.Generator) -> Machine:
    """Draw what disturbs a run: always the same numbers in the same order."""
    disturbance, sensor = machine.disturbance, machine.sensor
    accelerations = disturbance.acceleration_noise * rng.standard_normal(steps)
    for pulse in disturbance.pulses:
        accelerations[pulse.first_step : pulse.first_step + pulse.steps] += pulse.acceleration
    noise = rng.standard_normal((2, steps + 1))
    velocity_noise = sensor.velocity_noise if sensor.measures_velocity else np.nan
    return Machine(
        machine.system.plant,
        accelerations,
        sensor.position_noise * noise[0],
        velocity_noise * noise[1],
        float(sensor.position_step),
        float(sensor.position_lag),
    )
