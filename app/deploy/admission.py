"""Who may come in to a cluster: bounded by what its replicas may take on, and by their forecast."""

from math import inf
from time import perf_counter

from app.deploy.routing import Board, Order, now
from app.serving.admission import Admission, Lane, Work
from app.serving.rates import Rates
from app.serving.refusals import NotReady, Refused
from app.settings import Settings


class ClusterAdmission(Admission):
    """Refuses at the ingress what no replica could do in time; a replica has the last word.

    Args:
        settings: the bounds, of each replica.
        rates: of an ingress, which measures nothing.
        board: what is known of the replicas.
    """

    def __init__(self, settings: Settings, rates: Rates, board: Board) -> None:
        super().__init__(settings, rates, compiled_at_once=1)
        self._board = board

    @property
    def scale(self) -> int:
        return max(1, len(self._board))

    def _check_deadlines(self, new: Work, lane: Lane) -> None:  # noqa: ARG002
        order = order_of(new)
        if new.is_batch:  # it is done all over the cluster
            shares = self.scale
            order = order._replace(rows=order.rows // shares, steps=order.steps // shares)
        left = new.deadline - perf_counter()
        soonest = self._board.soonest(order, left, now())
        if soonest == inf:
            raise NotReady(f"no replica holds {order.model} yet")
        if soonest > left:
            detail = f"no replica has it done in less than {soonest:.2g} s, and its deadline is in "
            raise Refused("deadline", f"{detail}{left:.2g} s", soonest - left)


def order_of(work: Work) -> Order:
    """Return what routing has to know of a work."""
    return Order(
        model=work.model.label if work.model else None,
        rows=work.rows_left,
        kind=work.kind,
        steps=work.rollout_steps,
        is_batch=work.is_batch,
    )
