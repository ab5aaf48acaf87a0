"""The checkpoint as it is: its rows in slices, which change nothing."""

from collections.abc import Iterator

import pytest
import torch
from torch import Tensor, nn

from app.inference.networks.scripted import ScriptedNetwork
from app.inference.row_threads import ROWS_AT_A_TIME, RowThreads
from training.config import NetworkConfig
from training.unet import UNet


@pytest.fixture(scope="module")
def unet() -> UNet:
    torch.manual_seed(0)
    return UNet(NetworkConfig(channels=16, time_dimension=8, condition_dimension=8)).eval()


@pytest.fixture(params=[1, 2, 3], ids=lambda n: f"{n} threads")
def threads(request: pytest.FixtureRequest) -> Iterator[RowThreads]:
    threads = RowThreads(request.param)
    yield threads
    threads.close()


def network(module: nn.Module, threads: RowThreads) -> ScriptedNetwork:
    return ScriptedNetwork(torch.jit.script(module.eval()), threads)


def rows(count: int, network: ScriptedNetwork) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(count)
    embedding = torch.cat([network.embed(c) for c in torch.randn(3, 4, generator=generator)])
    return (
        torch.randn(count, 16, generator=generator),
        torch.randint(20, (count,), generator=generator),
        embedding[torch.randint(6, (count,), generator=generator)],
    )


@pytest.mark.parametrize("count", [1, 2, 3, 8, 17, 100])
def test_it_predicts_what_the_checkpoint_does_in_one_call(
    threads: RowThreads, unet: UNet, count: int
) -> None:
    scripted = network(unet, threads)
    u_t, t, embedding = rows(count, scripted)

    noise = scripted.predict(u_t, t, embedding)

    with torch.no_grad():
        expected = unet(u_t.unsqueeze(1), t, embedding[:, :4], embedding[:, 4] > 0)[:, 0]
    assert expected.std() > 0.1
    torch.testing.assert_close(noise, expected, rtol=0, atol=1e-5)


class ShowsRows(nn.Module):
    """Answers with how many rows it was given."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return torch.full_like(u, u.shape[0])


def test_it_sees_one_number_of_rows_whatever_it_is_asked(threads: RowThreads) -> None:
    """OneDNN keeps a compiled primitive for every shape."""
    scripted = network(ShowsRows(), threads)

    for count in (1, 2, 5, 9, 64, 100, 257, 1000, 4096):
        seen = scripted.predict(*rows(count, scripted))
        assert seen.min() == seen.max() == ROWS_AT_A_TIME


def test_a_row_is_the_same_in_any_company(threads: RowThreads, unet: UNet) -> None:
    scripted = network(unet, threads)
    asked = rows(100, scripted)

    together = scripted.predict(*asked)

    for i in (0, 7, 41, 99):
        alone = scripted.predict(*(part[i : i + 1] for part in asked))
        torch.testing.assert_close(alone, together[i : i + 1], rtol=0, atol=1e-6)


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
    threads: RowThreads, module: nn.Module
) -> None:
    scripted = network(module, threads)

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
    threads: RowThreads, unlucky: int
) -> None:
    scripted = network(FailsFor(), threads)
    u_t, _, embedding = rows(100, scripted)
    t = torch.zeros(100, dtype=torch.int64)
    t[unlucky] = 13

    with pytest.raises(RuntimeError, match="shape"):
        scripted.predict(u_t, t, embedding)

    t[unlucky] = 0
    assert torch.equal(scripted.predict(u_t, t, embedding), u_t)


def test_it_gives_no_gradients_to_keep(threads: RowThreads, unet: UNet) -> None:
    scripted = network(unet, threads)

    assert not scripted.predict(*rows(20, scripted)).requires_grad


def test_the_condition_is_kept_or_left_out_row_by_row(threads: RowThreads) -> None:
    scripted = network(ShowsCondition(), threads)
    condition = torch.tensor([0.5, 0.25, -1.0, 2.0])
    both = scripted.embed(condition)

    shown = scripted.predict(torch.zeros(4, 16), torch.zeros(4).long(), both[[0, 1, 1, 0]])

    assert shown[:, 0].tolist() == [1.75, -1, -1, 1.75]


class ShowsCondition(nn.Module):
    """Answers with the sum of the condition, or -1 where it is left out."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        shown = torch.where(keep, condition.sum(dim=1), -1.0)
        return u + shown[:, None, None]
