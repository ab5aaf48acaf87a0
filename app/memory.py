"""How the server process keeps its memory."""

import ctypes
import gc

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


def set_aside_what_stays() -> None:
    """Free what nobody uses, and look no more at what is left when garbage is collected.

    Hundreds of thousands of objects live as long as the process (PyTorch's, FastAPI's): to go
    through all of them, again and again, would halt every thread for a fifth of a second.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()
