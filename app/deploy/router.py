"""The router of Ray Serve that asks the board, and how many replicas there are to be."""

import math
from typing import Any

from ray.serve.config import AutoscalingContext
from ray.serve.request_router import (
    FIFOMixin,
    PendingRequest,
    ReplicaID,
    RequestRouter,
    RunningReplica,
)

from app.deploy.routing import BOARD, Load, Order, now

ROWS_PER_REPLICA = 4000
"""Rows through the network that wait at a replica before there is to be another: with the shipped
models about 0.2 s of two cores."""
SECONDS_PER_REPLICA = 0.2
"""Of compiled plans that wait, likewise."""


class LeastWork(FIFOMixin, RequestRouter):
    """Sends each work to where it is done first; its first argument is its `Order`.

    Where several wait to be sent, the first takes the next replica that was chosen. Without the
    mixin Ray tells them apart by the request that they are made for, and the parts of a batch are
    made for the same one: all but one of them would wait for ever.
    """

    def initialize_state(self, **_: Any) -> None:
        self._by_id: dict[str, RunningReplica] = {}
        self._ids: list[str] = []
        self._told: dict[str, dict[str, Any]] = {}

    def update_replicas(self, replicas: list[RunningReplica]) -> None:
        self._know(replicas)
        for replica in replicas:
            name, stats = replica.replica_id.unique_id, replica.routing_stats
            if stats and stats != self._told.get(name):  # they come again with any other's news
                self._told[name] = stats
                BOARD.tell(name, Load(**stats), now())
        super().update_replicas(replicas)

    def on_replica_actor_died(self, replica_id: ReplicaID) -> None:
        super().on_replica_actor_died(replica_id)
        self._know(list(self.curr_replicas.values()))

    def _know(self, replicas: list[RunningReplica]) -> None:
        self._by_id = {replica.replica_id.unique_id: replica for replica in replicas}
        self._ids = list(self._by_id)
        self._told = {name: told for name, told in self._told.items() if name in self._by_id}
        BOARD.keep(self._ids)

    async def choose_replicas(
        self,
        candidate_replicas: list[RunningReplica],  # noqa: ARG002
        pending_request: PendingRequest | None = None,
    ) -> list[list[RunningReplica]]:
        order = Order()
        if pending_request:
            order = pending_request.args[0]
            # Or else Ray asks again at once, and its loop does nothing else any more.
            pending_request.routing_context.should_backoff = True
        chosen = BOARD.choose(order, self._ids, now())
        return [[self._by_id[chosen]]] if chosen else []

    def on_request_routed(
        self,
        pending_request: PendingRequest,
        replica_id: ReplicaID,
        result: Any,  # noqa: ARG002
    ) -> None:
        BOARD.send(replica_id.unique_id, pending_request.args[0], now())


def by_outstanding_rows(context: AutoscalingContext) -> tuple[int, dict[str, Any]]:
    """Return how many replicas there are to be: as many as keep what waits at each short.

    Requests are not counted: one may take ten thousand times what another one does.
    """
    metrics = context.aggregated_metrics or {}
    rows = sum(metrics.get("rows", {}).values())
    seconds = sum(metrics.get("seconds", {}).values())
    wanted = math.ceil(rows / ROWS_PER_REPLICA + seconds / SECONDS_PER_REPLICA)
    least, most = context.capacity_adjusted_min_replicas, context.capacity_adjusted_max_replicas
    return max(least, min(wanted, most)), {}
