"""How the server process keeps its memory."""

import ctypes

M_ARENA_MAX = -8
"""glibc's number for mallopt."""


def use_few_arenas() -> None:
    """Let all threads share two of glibc's arenas; call it before there are any.

    By default each of the first eight threads a core gets an arena of its own, and what is freed
    there stays there: a service with a thread for each request under way would keep 64 MB and more
    for many of them. Other C libraries have no arenas, and are left as they are.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_ARENA_MAX, 2)
