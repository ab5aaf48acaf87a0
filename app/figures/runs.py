"""Figures of simulated runs of a machine."""

import numpy as np
from matplotlib.figure import Figure

from app.figures.plan import draw_controls, draw_stiction_band
from app.figures.style import BLACK, RED, new_figure
from app.wire.simulation import SimulateRequest, SimulateResponse


def draw_runs(request: SimulateRequest, answer: SimulateResponse) -> Figure:
    """Draw control, position and velocity of all runs over time; the stiction band is the truth's.

    Args:
        request: what was asked.
        answer: the runs, with their states.

    Raises:
        ValueError: the answer lacks states.
    """
    if any(run.states is None for run in answer.runs):
        raise ValueError("a figure needs an answer that includes states")
    controls = np.array([run.controls for run in answer.runs])
    states = np.array([run.states for run in answer.runs])
    times = answer.system.time_step * np.arange(states.shape[1])
    opacity = max(0.1, min(1.0, 4 / len(answer.runs)))

    figure = new_figure(5.0)
    control_axes, position_axes, velocity_axes = figure.subplots(3, sharex=True)
    draw_stiction_band(control_axes, answer.system)
    draw_controls(control_axes, times, controls, RED, 0.8, opacity)
    control_axes.set_ylabel(f"control ({answer.control_unit})")
    for axes, index, label in (
        (position_axes, 0, "position (m)"),
        (velocity_axes, 1, "velocity (m/s)"),
    ):
        axes.plot(times, states[:, :, index].T, color=RED, alpha=opacity, lw=1.0)
        if request.target_state is not None:
            axes.axhline(request.target_state[index], color=BLACK, ls="--", lw=1)
        axes.set_ylabel(label)
    if request.steps_left is not None:
        deadline = answer.system.time_step * request.steps_left
        position_axes.axvline(deadline, color=BLACK, ls=":", lw=1, label="deadline")
    position_axes.plot([], [], color=RED, lw=1.0, label=f"{answer.controller}, {len(states)} runs")
    position_axes.plot([], [], color=BLACK, ls="--", lw=1, label="target")
    figure.legend(loc="outside upper center", ncols=4)
    velocity_axes.set_xlabel("time (s)")
    velocity_axes.set_xlim(0, times[-1])
    return figure
