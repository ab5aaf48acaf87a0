"""What Ray's own router has to be told so that it never turns in circles."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("ray")

from app.deploy.router import LeastWork
from app.deploy.routing import Order


def test_where_no_replica_will_do_ray_waits_before_it_asks_again() -> None:
    router: Any = LeastWork.__new__(LeastWork)
    router.initialize_state()
    pending: Any = SimpleNamespace(
        args=[Order()], routing_context=SimpleNamespace(should_backoff=False)
    )
    assert asyncio.run(router.choose_replicas([], pending)) == []
    assert pending.routing_context.should_backoff
