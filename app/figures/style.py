"""One look for all figures: colours that colour-blind readers tell apart, legible in print."""

from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

PAGE_INCHES = 7.0

BLUE, ORANGE, GREEN, RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PINK, SKY, YELLOW, BLACK, GREY = "#cc79a7", "#56b4e9", "#f0e442", "#000000", "#7f7f7f"
"""The palette of Okabe and Ito."""


class Look(NamedTuple):
    """How figures draw an entrant, in matplotlib's words."""

    color: str
    marker: str
    ls: str


STYLE_FILE = Path(__file__).with_name("figures.mplstyle")
"""Fonts, lines and grid of all figures, as matplotlib reads them."""


def new_figure(height: float) -> Figure:
    """Return an empty figure as wide as a page and so high (inches), whose parts do not overlap."""
    return Figure(figsize=(PAGE_INCHES, height), layout="constrained")
