"""The picture of an identification: what a plant predicts of a log, and the friction it has."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.figures.style import BLACK, BLUE, GREY, RED, new_figure
from app.planning.arrays import FloatArray
from app.planning.identification.log_checks import checked_log
from app.planning.identification.prediction import Windows, trace
from app.planning.plant.friction import friction_of, weakening
from app.planning.plant.system import System
from app.wire.identification import IdentifyRequest, IdentifyResponse

NUM_SPEEDS = 200
COVERED = 2.5, 97.5
"""Percentiles of the ensemble between which a band lies."""


def draw_identification(request: IdentifyRequest, answer: IdentifyResponse) -> Figure:
    """Draw measured and predicted positions, their differences, and friction over velocity.

    Args:
        request: the log.
        answer: the plant, its ensemble and noise.
    """
    velocities = request.velocities
    log = checked_log(
        request.time_step,
        np.array(request.controls, dtype=np.float64),
        np.array(request.positions, dtype=np.float64),
        None if velocities is None else np.array(velocities, dtype=np.float64),
    ).delayed(answer.delay_steps)
    log = replace(log, position_lag=answer.position_lag)
    fit = answer.fit
    noises = np.array([fit.acceleration_noise, fit.position_noise, fit.velocity_noise or 1.0])
    plant = answer.system.plant
    believed = trace(np.array(plant, dtype=np.float64), noises, log.record(1))
    windows = Windows.of(plant, log, believed)

    figure = new_figure(6.0)
    position_axes, error_axes, friction_axes = figure.subplots(3)
    times = log.time_step * np.arange(log.num_steps + 1)
    position_axes.plot(times, log.positions, color=BLACK, lw=0.8, label="measured")
    within = times[windows.starts][:, np.newaxis] + log.time_step * np.arange(windows.steps + 1)
    position_axes.plot(within.T, windows.positions.T, color=RED, lw=0.8)
    position_axes.plot(
        [], [], color=RED, lw=0.8, label=f"predicted, {fit.window_s:.2g} s at a time"
    )
    position_axes.set(ylabel="position (m)", xlim=(0, times[-1]), xticklabels=[])
    position_axes.legend(loc="best")
    error_axes.axhline(0.0, color=GREY, lw=0.8)
    error_axes.plot(within.T, 1e3 * windows.errors.T, color=RED, lw=0.8)
    error_axes.set(ylabel="predicted less\nmeasured (mm)", xlabel="time (s)", xlim=(0, times[-1]))
    fastest = float(np.quantile(np.abs(believed.velocities), 0.99))
    _draw_friction(friction_axes, answer, fastest)
    return figure


def _draw_friction(axes: Axes, answer: IdentifyResponse, fastest: float) -> None:
    """Draw what opposes motion over velocity, up to the fastest that the log has."""
    speeds = np.linspace(0.0, fastest, NUM_SPEEDS)[1:]
    for direction in (-1.0, 1.0):
        of_systems = [friction_curve(system, direction, speeds) for system in answer.systems]
        low, high = np.percentile(of_systems, COVERED, axis=0)
        axes.fill_between(direction * speeds, low, high, color=BLUE, alpha=0.2, lw=0)
        curve = friction_curve(answer.system, direction, speeds)
        axes.plot(direction * speeds, curve, color=BLUE)
        statics = [direction * friction_of(direction, s.plant).static for s in answer.systems]
        static = direction * friction_of(direction, answer.system.plant).static
        low, high = np.percentile(statics, COVERED)
        axes.errorbar(
            [0.0],
            [static],
            [[max(0.0, static - low)], [max(0.0, high - static)]],
            color=RED,
            marker="o",
            ms=3,
            capsize=3,
            ls="none",
        )
    axes.plot([], [], color=BLUE, label="sliding, with 95 % of the ensemble")
    axes.plot([], [], color=RED, marker="o", ms=3, ls="none", label="static")
    axes.set(xlabel="velocity (m/s)", ylabel="friction (m/s²)")
    axes.legend(loc="best")


def friction_curve(system: System, direction: float, speeds: FloatArray) -> FloatArray:
    """Return the friction of a sliding mass at speeds (N,) in a direction, m/s^2, with its sign."""
    plant = system.plant
    friction = friction_of(direction, plant)
    excess = np.array([weakening(float(speed), friction, plant) for speed in speeds])
    return direction * (friction.coulomb + excess + friction.damping * speeds)
