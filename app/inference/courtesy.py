"""Threads that compute for long let those go first that answer at once."""

import os
import sys
import threading

NICENESS = 10
"""Added to the process's own: a tenth of the others' weight, where both want the same core."""


def give_way() -> None:
    """Let the kernel's scheduler prefer the process's other threads to the calling one.

    A thread that wakes to answer then need not wait for the end of a time slice, some
    milliseconds, of one that computes. Alone on its core a thread loses nothing. Linux knows a
    niceness of threads; elsewhere nothing happens.
    """
    if sys.platform == "linux":
        thread = threading.get_native_id()
        nice = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, nice + NICENESS)
