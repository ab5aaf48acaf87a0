"""Which replica takes which work, and when it would be done."""

import random
from collections import Counter
from math import inf

import pytest

from app.deploy.routing import Board, Load, Order

FAST, SLOW = Load({"m/1": 1e-4}, {"cem": 1e-8}), Load({"m/1": 1e-3}, {"cem": 1e-7})
ROWS, STEPS = Order("m/1", rows=100), Order(kind="cem", steps=1_000_000)


def board(**loads: Load) -> Board:
    known = Board(random.Random(0))
    for replica, load in loads.items():
        known.tell(replica, load, now=0.0)
    return known


@pytest.mark.parametrize("order", [ROWS, STEPS])
def test_work_goes_where_it_is_done_first(order: Order) -> None:
    known = board(a=SLOW, b=FAST)
    assert known.choose(order, ["a", "b"], now=0.0) == "b"


def test_what_was_sent_counts_until_it_is_done() -> None:
    known = board(a=FAST, b=FAST)
    for _ in range(10):
        known.send("a", ROWS, now=0.0)
    assert known.finish("a", STEPS, now=0.0) == known.finish("b", STEPS, now=0.0)
    assert known.choose(ROWS, ["a", "b"], now=0.0) == "b"
    assert known.finish("a", ROWS, now=1.0) == known.finish("b", ROWS, now=1.0)


def test_what_a_replica_says_comes_instead_of_what_was_sent() -> None:
    known = board(a=FAST)
    known.send("a", STEPS, now=0.0)
    known.tell("a", Load(FAST.models, FAST.kinds, {"short": 3.0}), now=0.0)
    assert known.finish("a", STEPS, now=1.0) == pytest.approx((2.01, 2.0))


def test_a_small_sampling_waits_for_no_large_one() -> None:
    known = board(a=FAST)
    known.send("a", Order("m/1", rows=1_000_000), now=0.0)
    assert known.finish("a", ROWS, now=0.0)[0] == pytest.approx(0.02)


def test_a_model_is_looked_for_where_it_is_held() -> None:
    replicas = {f"r{i}": Load() for i in range(50)} | {"holder": FAST}
    known = board(**replicas)
    assert {known.choose(ROWS, list(replicas), now=0.0) for _ in range(50)} == {"holder"}
    assert known.soonest(Order("other/1", rows=1), within=1.0, now=0.0) == inf
    assert known.soonest(ROWS, within=1.0, now=0.0) < 1.0


def test_a_pinned_work_goes_elsewhere_only_when_its_replica_is_gone() -> None:
    known = board(a=FAST, b=FAST)
    known.send("a", STEPS, now=0.0)
    pinned = STEPS._replace(pinned="a")
    assert known.choose(pinned, ["a", "b"], now=0.0) == "a"
    known.keep(["b"])
    assert known.choose(pinned, ["b"], now=0.0) == "b"
    assert known.choose(pinned, [], now=0.0) is None


def test_who_died_or_refused_is_avoided() -> None:
    known = board(a=FAST, b=FAST)
    avoiding = STEPS._replace(avoided=frozenset("a"))
    assert {known.choose(avoiding, ["a", "b"], now=0.0) for _ in range(20)} == {"b"}
    assert known.choose(avoiding, ["a"], now=0.0) is None


def test_before_anything_is_known_any_replica_will_do() -> None:
    known = board()
    assert known.choose(ROWS, ["a"], now=0.0) == "a"
    assert known.soonest(ROWS, within=1.0, now=0.0) == 0.0


def test_ingresses_that_know_the_same_do_not_all_choose_the_same() -> None:
    loads = {f"r{i}": Load(queued={"short": 0.1 + i * 1e-6}) for i in range(100)}
    chosen = Counter(
        board_of.choose(STEPS, list(loads), now=0.0)
        for board_of in [board(**loads)]
        for _ in range(400)
    )
    assert len(chosen) > 20
