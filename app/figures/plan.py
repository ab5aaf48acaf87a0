"""Figures of answers, in the manner of the paper."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from app.figures.style import BLACK, BLUE, GREY, RED, new_figure
from app.planning.plant.friction import resting_controls
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.wire.answers import PlanResponse
from app.wire.requests import PlanRequest

BOLD = 1.8
"""Width of the selected plan's line."""


def draw_plan(request: PlanRequest, answer: PlanResponse) -> Figure:
    """Draw control, position and velocity over time: candidates faint, the plan bold (Fig. 1).

    Args:
        request: what was asked.
        answer: the plan with its candidates; nobody's states are needed.

    Raises:
        ValueError: the answer lacks candidates.
    """
    if answer.candidates is None:
        raise ValueError("a figure needs an answer that includes candidates")
    controls = np.array([*answer.candidates.controls, answer.controls])
    start = answer.predicted_initial_state or request.initial_state
    states = rollout(answer.system, np.array(start), controls)
    times = answer.system.time_step * np.arange(states.shape[1])
    num_candidates = len(answer.candidates.controls)
    opacity = max(0.06, min(0.5, 8 / num_candidates))

    figure = new_figure(5.0)
    control_axes, position_axes, velocity_axes = figure.subplots(3, sharex=True)
    draw_stiction_band(control_axes, answer.system)
    draw_controls(control_axes, times, controls[:-1], BLUE, 0.6, opacity)
    draw_controls(control_axes, times, controls[-1:], RED, BOLD)
    control_axes.set_ylabel(f"control ({answer.control_unit})")
    for axes, index, label in (
        (position_axes, 0, "position (m)"),
        (velocity_axes, 1, "velocity (m/s)"),
    ):
        axes.plot(times, states[:-1, :, index].T, color=BLUE, alpha=opacity, lw=0.6)
        axes.plot(times, states[-1, :, index], color=RED, lw=BOLD)
        axes.axhline(request.target_state[index], color=BLACK, ls="--", lw=1)
        axes.set_ylabel(label)
    position_axes.plot([], [], color=BLUE, lw=0.6, label=f"{num_candidates} candidates")
    position_axes.plot([], [], color=RED, lw=BOLD, label="selected")
    position_axes.plot([], [], color=BLACK, ls="--", lw=1, label="target")
    figure.legend(loc="outside upper center", ncols=4)
    velocity_axes.set_xlabel("time (s)")
    velocity_axes.set_xlim(0, times[-1])
    return figure


def draw_stiction_band(axes: Axes, system: System) -> None:
    """Draw the band of controls in which a mass at rest stays at rest, and set the limits."""
    plant = system.plant
    axes.axhspan(*resting_controls(plant), color=GREY, alpha=0.15, lw=0, label="stiction band")
    margin = 0.05 * (plant.highest_control - plant.lowest_control)
    axes.set_ylim(plant.lowest_control - margin, plant.highest_control + margin)


def draw_controls(
    axes: Axes, times: ArrayLike, controls: ArrayLike, color: str, width: float, opacity: float = 1
) -> None:
    """Draw piecewise constant controls (K, H) between `times` (H+1,)."""
    held = np.pad(controls, ((0, 0), (0, 1)), mode="edge")
    axes.plot(times, held.T, drawstyle="steps-post", color=color, lw=width, alpha=opacity)
