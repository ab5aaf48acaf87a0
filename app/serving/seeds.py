"""The seed of a request, drawn here where it names none."""

import secrets

from app.wire.requests import MAX_SEED


def drawn_seed(asked: int | None, most: int = MAX_SEED) -> int:
    """Return the seed that was asked for, or draw one of 0 to `most`."""
    return secrets.randbelow(most + 1) if asked is None else asked
