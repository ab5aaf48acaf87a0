"""Figures of answers, in the manner of the paper."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.api.schemas import PlanResponse
from app.client.sampler_frontier import Point
from app.planning.system import System

FAINT = "#0072b2"
BOLD = "#d55e00"
TARGET = "#000000"
FRONTIER_LINES = (
    ("ddim", 1.0, "#56b4e9", "o--"),
    ("ddim", 1.5, "#56b4e9", "o:"),
    ("ddim", 2.0, FAINT, "o-"),
    ("dpm_solver", 1.0, "#e69f00", "s--"),
    ("dpm_solver", 1.5, "#e69f00", "s:"),
    ("dpm_solver", 2.0, BOLD, "s-"),
)
"""Solver, guidance scale, colour and style of the lines of a frontier."""


def draw_plan(answer: PlanResponse, target_state: tuple[float, float], path: Path) -> None:
    """Draw control, position and velocity over time: candidates faint, the plan bold (Fig. 1).

    Args:
        answer: a plan with its states and candidates.
        target_state: x*.
        path: where to; the ending decides the format.

    Raises:
        ValueError: the answer lacks states or candidates, or the format is unknown.
    """
    if answer.states is None or answer.candidates is None or answer.candidates.states is None:
        raise ValueError("a figure needs an answer that includes states and candidates")
    controls = np.array(answer.candidates.controls)
    states = np.array(answer.candidates.states)
    system = answer.system
    times = system.time_step * np.arange(controls.shape[1] + 1)

    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
    control_axes, position_axes, velocity_axes = figure.subplots(3, sharex=True)
    opacity = max(0.04, min(0.5, 8 / len(controls)))
    _draw_controls(control_axes, times, controls, np.array(answer.controls), system, opacity)
    for axes, index, label in (
        (position_axes, 0, "position (m)"),
        (velocity_axes, 1, "velocity (m/s)"),
    ):
        axes.plot(times, states[:, :, index].T, color=FAINT, alpha=opacity, lw=0.8)
        axes.plot(times, np.array(answer.states)[:, index], color=BOLD, lw=2.2)
        axes.axhline(target_state[index], color=TARGET, ls="--", lw=1)
        axes.set_ylabel(label)
    position_axes.plot([], [], color=FAINT, lw=0.8, label=f"{len(controls)} candidates")
    position_axes.plot([], [], color=BOLD, lw=2.2, label="selected")
    position_axes.plot([], [], color=TARGET, ls="--", lw=1, label="target")
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    velocity_axes.set_xlabel("time (s)")
    velocity_axes.set_xlim(0, times[-1])
    figure.savefig(path, dpi=150)


def _draw_controls(
    axes: Axes,
    times: "np.ndarray[tuple[int], np.dtype[np.float64]]",
    candidates: "np.ndarray[tuple[int, int], np.dtype[np.float64]]",
    selected: "np.ndarray[tuple[int], np.dtype[np.float64]]",
    system: System,
    opacity: float,
) -> None:
    """Draw piecewise constant controls, and the band in which a mass at rest stays at rest."""
    axes.axhspan(
        -system.static_friction,
        system.static_friction,
        color="0.5",
        alpha=0.15,
        lw=0,
        label="stiction band",
    )
    axes.set_ylim(-1.1 * system.control_limit, 1.1 * system.control_limit)
    for sequence in candidates:
        axes.stairs(sequence, times, baseline=None, color=FAINT, alpha=opacity, lw=0.8)
    axes.stairs(selected, times, baseline=None, color=BOLD, lw=2.2)
    axes.set_ylabel("control (m/s²)")


def draw_frontier(points: Sequence[Point], path: Path) -> None:
    """Draw mean end error over network evaluations, a panel for each K, a line for each sampler.

    Args:
        points: measured settings.
        path: where to; the ending decides the format.

    Raises:
        ValueError: the format is unknown.
    """
    budgets = sorted({point.num_candidates for point in points})
    figure = Figure(figsize=(3.0 * len(budgets) + 0.6, 3.4), layout="constrained")
    panels = figure.subplots(1, len(budgets), squeeze=False)[0]
    for axes, k in zip(panels, budgets, strict=True):
        for name, scale, color, style in FRONTIER_LINES:
            line = sorted(
                (_evaluations(point), point.error)
                for point in points
                if point.num_candidates == k
                and (point.setting.settings.solver, point.setting.settings.guidance_scale)
                == (name, scale)
            )
            label = f"{name}, s = {scale:g}" if k == budgets[0] else None
            if line:
                axes.plot(*zip(*line, strict=True), style, color=color, label=label)
        (paper,) = (p for p in points if p.num_candidates == k and p.setting.sampler == "paper")
        axes.plot(
            _evaluations(paper), paper.error, "*", color=TARGET, ms=11,
            label="the paper's setting" if k == budgets[0] else None,
        )  # fmt: skip
        axes.set_title(f"K = {k}")
        axes.set_xscale("log")
        axes.set_xticks([1, 2, 5, 10, 20, 50, 100], labels=["1", "2", "5", "10", "20", "50", "100"])
        axes.set_xlabel("network evaluations")
        axes.set_yscale("log")
        axes.set_yticks([0.05, 0.1, 0.2, 0.5, 1], labels=["0.05", "0.1", "0.2", "0.5", "1"])
        axes.set_ylim(0.04, 1)
    panels[0].set_ylabel("mean end error (m)")
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    figure.savefig(path, dpi=150)


def _evaluations(point: Point) -> int:
    return point.setting.cost(point.num_candidates).network_evaluations
