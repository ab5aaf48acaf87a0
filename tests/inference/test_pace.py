"""The pace by a clock that the network moves."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from app.inference import pace
from app.inference.device import CPU
from app.inference.pace import OVERHEAD_SECONDS, REPETITIONS, SIZES, measure_pace


class Clocked:
    """A network that takes so many seconds for a batch."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: Callable[[int], float]) -> None:
        self.now = 0.0
        self.rows: list[int] = []
        self._seconds = seconds
        monkeypatch.setattr(pace, "perf_counter", lambda: self.now)

    def embed(self, condition: Tensor) -> Tensor:
        assert condition.shape == (4,)
        return torch.zeros(2, 6)

    def predict(self, u_t: Tensor, t: Tensor, embedding: Tensor) -> Tensor:
        assert u_t.shape == (len(u_t), 24)
        assert (t.shape, t.dtype) == ((len(u_t),), torch.int64)
        assert embedding.shape == (len(u_t), 6)
        self.rows.append(len(u_t))
        self.now += self._seconds(len(u_t))
        return u_t


@pytest.mark.parametrize(
    ("seconds", "rows_at_once"),
    [
        (lambda rows: 0.001 * rows, 16),
        (lambda rows: 0.001 * rows + 0.0008, 16),
        (lambda rows: 0.001 * rows + 0.002, 32),
        (lambda _: 0.01, 256),
        (lambda rows: 0.001 * max(rows, 100), 128),
        (lambda rows: 0.001 * rows * (1 if rows < 50 else 2), 16),
    ],
    ids=["even", "almost even", "start", "flat", "wide", "caches"],
)
def test_the_fewest_rows_are_taken_with_which_a_row_takes_about_the_least_time(
    monkeypatch: pytest.MonkeyPatch,
    seconds: Callable[[int], float],
    rows_at_once: int,
) -> None:
    network = Clocked(monkeypatch, seconds)

    measured = measure_pace(network, 4, 24, CPU)

    assert measured.rows_at_once == rows_at_once
    expected = (seconds(rows_at_once) + OVERHEAD_SECONDS) / rows_at_once
    assert measured.seconds_per_row == pytest.approx(expected)
    assert sorted(network.rows) == sorted(SIZES * REPETITIONS)


def test_a_hiccup_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    def seconds(rows: int) -> float:
        return 0.001 * rows + (5.0 if network.rows.count(rows) in (1, 4) else 0.0)

    network = Clocked(monkeypatch, seconds)

    measured = measure_pace(network, 4, 24, CPU)

    assert measured.rows_at_once == 16
    assert measured.seconds_per_row == pytest.approx(0.001, rel=0.02)
