"""The checkpoint as it is: its rows in slices of one size, and what goes wrong in them."""

import pytest
import torch
from torch import Tensor, nn

from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import ROWS_AT_A_TIME, RowThreads
from tests.inference.networks.conftest import CONDITION_SIZE, Read


def rows(count: int, network: ScriptedNetwork) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(count)
    conditions = torch.randn(3, CONDITION_SIZE, generator=generator)
    embedding = torch.cat([network.embed(condition) for condition in conditions])
    return (
        torch.randn(count, 16, generator=generator),
        torch.randint(20, (count,), generator=generator),
        embedding[torch.randint(6, (count,), generator=generator)],
    )


class ShowsRows(nn.Module):
    """Answers with how many rows it was given."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return torch.full_like(u, u.shape[0])


def test_it_sees_one_number_of_rows_whatever_it_is_asked(threads: RowThreads, read: Read) -> None:
    """OneDNN keeps a compiled primitive for every shape."""
    scripted = ScriptedNetwork(read(ShowsRows()), threads)

    for count in (1, 2, 5, 9, 64, 100, 257, 1000, 4096):
        seen = scripted.predict(*rows(count, scripted))
        assert seen.min() == seen.max() == ROWS_AT_A_TIME


class AnswersOnePosition(nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return u[:, :, :1]


class AnswersOneRow(nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return u[:1]


class AnswersTwoChannels(nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return u[:, 0].unsqueeze(2).repeat(1, 1, 1)


@pytest.mark.parametrize(
    "module",
    [AnswersOnePosition(), AnswersOneRow(), AnswersTwoChannels()],
    ids=lambda m: type(m).__name__,
)
def test_an_answer_in_another_shape_is_refused_and_not_spread_over_the_rows(
    threads: RowThreads, read: Read, module: nn.Module
) -> None:
    scripted = ScriptedNetwork(read(module), threads)

    with pytest.raises(RuntimeError, match="the output has shape"):
        scripted.predict(*rows(20, scripted))


class FailsFor(nn.Module):
    """Fails for rows of time 13."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        if bool((t == 13).any()):
            return u.reshape(-1, 7)
        return u


@pytest.mark.parametrize("unlucky", [0, 50, 99])
def test_what_goes_wrong_in_one_slice_goes_wrong_for_all_and_the_threads_live_on(
    threads: RowThreads, read: Read, unlucky: int
) -> None:
    scripted = ScriptedNetwork(read(FailsFor()), threads)
    u_t, _, embedding = rows(100, scripted)
    t = torch.zeros(100, dtype=torch.int64)
    t[unlucky] = 13

    with pytest.raises(RuntimeError, match="shape"):
        scripted.predict(u_t, t, embedding)

    t[unlucky] = 0
    assert torch.equal(scripted.predict(u_t, t, embedding), u_t)


def test_the_condition_is_kept_or_left_out_row_by_row(threads: RowThreads, read: Read) -> None:
    scripted = ScriptedNetwork(read(ShowsCondition()), threads)
    condition = torch.tensor([0.5, 0.25, -1.0, 2.5, -0.5])
    both = scripted.embed(condition)

    shown = scripted.predict(torch.zeros(4, 16), torch.zeros(4).long(), both[[0, 1, 1, 0]])

    assert shown[:, 0].tolist() == [1.75, -1, -1, 1.75]


class ShowsCondition(nn.Module):
    """Answers with the sum of the condition, or -1 where it is left out."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        shown = torch.where(keep, condition.sum(dim=1), -1.0)
        return u + shown[:, None, None]
