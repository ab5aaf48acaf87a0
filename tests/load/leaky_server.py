"""The service with a leak: it keeps every plan that it ever made. The memory check must see it."""

from collections.abc import Callable
from typing import Any

from app.cli import breakaway
from app.serving import service


def keeping_all(plan: Callable[..., Any]) -> Callable[..., Any]:
    kept = []

    def keep(*arguments: Any) -> Any:
        kept.append(plan(*arguments))
        return kept[-1]

    return keep


if __name__ == "__main__":
    for name in ("plan", "plan_multistep"):
        setattr(service, name, keeping_all(getattr(service, name)))
    breakaway()
