"""What is timed in turn is kept apart, by a clock that the calls move."""

import pytest

from app.benchmark import pairing


class Clock:
    """A call of `call` takes the next of its milliseconds."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        self.called: list[str] = []
        monkeypatch.setattr(pairing, "perf_counter", lambda: self.now)
        monkeypatch.setattr(pairing, "sleep", lambda _: None)

    def call(self, name: str, milliseconds: list[float]) -> None:
        self.now += milliseconds[self.called.count(name)] / 1e3
        self.called.append(name)


def test_pairs_alternate_and_the_first_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)

    first, second = pairing.paired(
        lambda: clock.call("first", [900, 1, 3, 2]),
        lambda: clock.call("second", [9, 20, 40, 30]),
        3,
    )

    assert clock.called == ["first", "second"] * 4
    assert (first, second) == pytest.approx((2, 30))


def test_the_median_leaves_out_the_first_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    times = [900.0] * pairing.UNMEASURED + [float(n) for n in range(pairing.MEASURED)]

    median = pairing.median_ms(lambda: clock.call("it", times))

    assert len(clock.called) == len(times)
    assert median == pytest.approx((pairing.MEASURED - 1) / 2)
