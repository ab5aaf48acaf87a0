"""Who is taken on: bounds of cost, deadlines that are kept, and nobody forgotten."""

import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from time import perf_counter
from types import SimpleNamespace
from typing import Any, cast

import pytest

from app.inference.engine import Tick
from app.inference.model import Model
from app.inference.model_card import Pace
from app.serving.admission import MARGIN, MARGIN_SECONDS, WRITING_SECONDS, Admission, Pending, Work
from app.serving.rates import CROWDED, MEMORY, PRIOR_ROWS, SECONDS_PER_STEP, Rates
from app.serving.refusals import Refused
from app.settings import Settings

MODEL = cast(
    Model, SimpleNamespace(label="fake/1", pace=Pace(rows_at_once=10, seconds_per_row=1e-3))
)
"""A row takes a millisecond."""


def in_time_if_it_takes(seconds: float) -> float:
    """Return a deadline; the margin is that of a few requests."""
    return perf_counter() + MARGIN * seconds + 6 * MARGIN_SECONDS


def sampling(rows: int, seconds: float = 60) -> Work:
    return Work(
        rows,
        deadline=in_time_if_it_takes(seconds),
        model=MODEL,
        rows_per_step=10,
        rollout_steps=0,
        kind="action_diffusion",
        answer_bytes=0,
    )


def computing(takes: float, seconds: float = 60) -> Work:
    return Work(
        0,
        deadline=in_time_if_it_takes(seconds),
        model=None,
        rows_per_step=2,
        rollout_steps=int(takes / SECONDS_PER_STEP),
        kind="cem",
        answer_bytes=0,
    )


def admission(compiled_at_once: int = 1, **settings: Any) -> Admission:
    return Admission(Settings(**settings), Rates(), compiled_at_once)


def admit(stack: ExitStack, admission: Admission, work: Work) -> Work:
    stack.enter_context(admission.admitted(work))
    return work


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.mark.parametrize(
    ("settings", "make", "what"),
    [
        ({"max_pending": 2}, partial(sampling, 100), "3 requests"),
        ({"max_pending_rows": 299}, partial(sampling, 100), "300 rows"),
        ({"max_pending_rollout_steps": 299_999_999}, partial(computing, 2), "300000000 simulated"),
    ],
)
def test_no_more_is_taken_on_than_the_settings_allow(
    stack: ExitStack, settings: dict[str, int], make: Callable[[], Work], what: str
) -> None:
    admits, work = admission(**settings), make()
    for _ in range(2):
        admit(stack, admits, replace(work, deadline=math.inf, kind=""))

    with pytest.raises(Refused, match=what) as refused:
        admit(stack, admits, work)
    assert refused.value.reason == "queue_full"
    assert len(admits) == 2

    stack.close()
    admit(stack, admits, work)
    assert admits.works == [work]


def test_what_was_taken_on_is_forgotten_when_it_is_done_however_it_ends() -> None:
    admits = admission()
    with pytest.raises(ZeroDivisionError), admits.admitted(sampling(1)):
        raise ZeroDivisionError
    assert len(admits) == 0


def test_what_cannot_make_its_deadline_alone_is_refused_and_told_by_how_much(
    stack: ExitStack,
) -> None:
    with pytest.raises(Refused, match="deadline") as refused:
        admit(stack, admission(), sampling(4000, seconds=1))
    assert refused.value.reason == "deadline"
    assert refused.value.retry_after_s == math.ceil(MARGIN * 3)
    admit(stack, admission(), sampling(4000, seconds=4.1))


def test_who_would_wait_too_long_behind_others_is_refused(stack: ExitStack) -> None:
    admits = admission()
    for _ in range(5):
        admit(stack, admits, sampling(1000, seconds=5.1))
    with pytest.raises(Refused):
        admit(stack, admits, sampling(1000, seconds=5.9))
    admit(stack, admits, sampling(1000, seconds=6.1))


def test_a_near_deadline_goes_before_those_that_have_time(stack: ExitStack) -> None:
    admits = admission()
    for _ in range(5):
        admit(stack, admits, sampling(1000))
    admit(stack, admits, sampling(1000, seconds=2))


def test_a_small_one_is_not_held_up_by_large_ones(stack: ExitStack) -> None:
    admits = admission()
    for _ in range(5):
        admit(stack, admits, sampling(5000))
    admit(stack, admits, sampling(30, seconds=0.2))


def test_who_would_make_another_one_late_is_refused(stack: ExitStack) -> None:
    admits = admission()
    promised = admit(stack, admits, sampling(2000, seconds=2.1))
    with pytest.raises(Refused, match="another"):
        admit(stack, admits, sampling(1500))

    promised.rows_left = 100
    admit(stack, admits, sampling(1500))


def test_who_would_hold_up_one_that_is_late_already_is_refused(stack: ExitStack) -> None:
    admits = admission()
    late = admit(stack, admits, sampling(2000, seconds=2.1))
    late.rows_left = 2500
    with pytest.raises(Refused, match="another"):
        admit(stack, admits, sampling(100, seconds=5))


def test_one_whose_deadline_has_passed_holds_up_nobody(stack: ExitStack) -> None:
    admits = admission()
    late = admit(stack, admits, sampling(2000, seconds=2.1))
    late.deadline = perf_counter()
    admit(stack, admits, sampling(100, seconds=5))


def test_a_long_compiled_plan_that_would_slow_down_a_promised_sampling_is_refused(
    stack: ExitStack,
) -> None:
    admits = admission()
    admit(stack, admits, sampling(1000, seconds=1.9))
    with pytest.raises(Refused, match="another"):
        admit(stack, admits, computing(5))
    admit(stack, admits, computing(0.01))


def test_what_is_pending_is_told_by_model(stack: ExitStack) -> None:
    admits = admission()
    admit(stack, admits, sampling(100)).rows_left = 70
    admit(stack, admits, sampling(50))
    admit(stack, admits, computing(1))

    assert admits.pending == {"fake/1": Pending(2, 120), "none": Pending(1, 0)}
    stack.close()
    assert admits.pending == {}


def test_answers_are_counted_until_they_are_sent_and_bounded(stack: ExitStack) -> None:
    admits = admission(max_pending_answer_bytes=1000)
    work = replace(sampling(100), answer_bytes=600)
    stack.enter_context(admits.answering(work))
    stack.enter_context(admits.answering(replace(computing(1), answer_bytes=400)))
    assert admits.pending == {"fake/1": Pending(0, 0, 600), "none": Pending(0, 0, 400)}

    another = replace(sampling(100), answer_bytes=100)
    with pytest.raises(Refused, match="with this one, 1100 bytes of answers") as refused:
        stack.enter_context(admits.answering(another))
    assert refused.value.reason == "queue_full"

    work.answer_bytes = 500  # it became shorter than expected
    admit(stack, admits, work)
    with admits.answering(another):
        assert admits.pending["fake/1"] == Pending(1, 100, 600)
    assert admits.pending["fake/1"] == Pending(1, 100, 500)
    stack.close()
    assert admits.pending == {}


def test_who_would_wait_too_long_behind_the_writing_of_answers_is_refused(
    stack: ExitStack,
) -> None:
    admits = admission()
    large = replace(computing(0.01), answer_bytes=int(1 / WRITING_SECONDS))
    admit(stack, admits, large)
    admit(stack, admits, computing(0.01, seconds=0.5))  # it has a lane of its own
    with pytest.raises(Refused):
        admit(stack, admits, computing(1, seconds=1.5))
    admit(stack, admits, computing(1, seconds=2.5))


def test_compiled_plans_wait_for_cores_and_not_for_the_network(stack: ExitStack) -> None:
    admits = admission(compiled_at_once=2)
    admit(stack, admits, sampling(10_000))
    for _ in range(2):
        admit(stack, admits, computing(1, seconds=1.9))
    with pytest.raises(Refused):
        admit(stack, admits, computing(1, seconds=1.9))
    admit(stack, admits, computing(1, seconds=2.1))


def test_rates_follow_what_work_took() -> None:
    rates = Rates()
    assert rates.seconds_of_rows(MODEL, 1, is_crowded=False) == pytest.approx(1e-3)
    assert rates.seconds_of_steps("cem", 1) == pytest.approx(SECONDS_PER_STEP)
    for _ in range(1000):
        rates.add_tick(Tick(MODEL, rows=10, seconds=0.02, is_crowded=False))
        rates.add_steps("cem", seconds=1.0, steps=10_000)
    assert rates.seconds_of_rows(MODEL, 50, is_crowded=False) == pytest.approx(0.1, rel=1e-2)
    assert rates.seconds_of_steps("cem", 10_000) == pytest.approx(1, rel=1e-2)
    assert rates.seconds_of_steps("mppi", 1) == pytest.approx(SECONDS_PER_STEP)


def test_rows_beside_long_compiled_plans_have_a_rate_of_their_own() -> None:
    rates = Rates()
    assert rates.seconds_of_rows(MODEL, 1, is_crowded=True) == pytest.approx(CROWDED * 1e-3)
    for _ in range(1000):
        rates.add_tick(Tick(MODEL, rows=10, seconds=0.05, is_crowded=True))
    assert rates.seconds_of_rows(MODEL, 1, is_crowded=True) == pytest.approx(5e-3, rel=1e-2)
    assert rates.seconds_of_rows(MODEL, 1, is_crowded=False) == pytest.approx(1e-3)


def test_one_odd_measurement_hardly_changes_a_rate() -> None:
    rates = Rates()
    rates.add_tick(Tick(MODEL, rows=10, seconds=0.05, is_crowded=False))
    expected = (MEMORY * PRIOR_ROWS * 1e-3 + 0.05) / (MEMORY * PRIOR_ROWS + 10)
    assert rates.seconds_of_rows(MODEL, 1, is_crowded=False) == pytest.approx(expected)


def batch(takes: float, seconds: float = 60) -> Work:
    return replace(computing(takes, seconds), is_batch=True)


def test_a_batch_waits_behind_long_plans_and_no_long_plan_behind_it(stack: ExitStack) -> None:
    admits = admission()
    admit(stack, admits, batch(20))
    admit(stack, admits, computing(1, seconds=1.2))
    with pytest.raises(Refused):
        admit(stack, admits, batch(1, seconds=1.5))
    admit(stack, admits, batch(1, seconds=4.2))


def test_who_would_make_a_batch_late_is_refused_unless_its_own_client_keeps_it(
    stack: ExitStack,
) -> None:
    admits = admission()
    promised = admit(stack, admits, batch(2, seconds=2.1))
    with pytest.raises(Refused, match="another"):
        admit(stack, admits, computing(1))
    promised.is_held_up = True
    admit(stack, admits, computing(1))


def test_a_batch_that_would_make_others_late_is_refused(stack: ExitStack) -> None:
    admits = admission()
    admit(stack, admits, sampling(2000, seconds=2.1))
    with pytest.raises(Refused, match="another"):
        admit(stack, admits, replace(sampling(1500), is_batch=True))
