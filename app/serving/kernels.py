"""The parts in which a service's kernels are compiled."""

import threading
from collections.abc import Iterable

import loky

from app.compilation.parts import Part, compile_for_all_levels, compile_missing
from app.terminal import progress_line

PLANNING = (
    Part("refinement", "app.planning.warm_up:make_refined_plans"),
    Part("the reachable set", "app.planning.warm_up:make_bounded_plan"),
    Part("the methods", "app.planning.warm_up:make_plans"),
)
"""Whoever plans needs them; the longest first."""
IDENTIFICATION = (Part("identification", "app.planning.warm_up:weigh_log"),)
"""Whoever has a log needs them."""
CONTROL = (Part("the closed loop", "app.planning.warm_up:make_control_step"),)
"""Whoever runs a closed loop needs them, and those of planning."""
LOOPS = (*CONTROL, *IDENTIFICATION)
"""Plans do without them."""
NETWORK = (Part("the network", "app.inference.kernel:warm_up"),)
"""TorchScript does without them."""
ALL = (*PLANNING, *LOOPS, *NETWORK)


def available_cores() -> int:
    """Return the cores that this process may use: the cgroup's quota, not the host's count."""
    return int(loky.cpu_count())


def prepare(parts: Iterable[Part]) -> None:
    """Compile what no earlier process left, with a line on the terminal that tells so; blocks."""
    with progress_line() as show:
        compile_missing(parts, available_cores(), show, threading.Event())


if __name__ == "__main__":  # for an image, which does not know where it will run
    prepare(ALL)
    compile_for_all_levels(ALL)
