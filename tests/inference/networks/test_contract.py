"""What every network of the registry promises, whatever it is made of."""

from typing import NamedTuple

import pytest
import torch
from torch import Tensor

from app.inference.networks import KINDS, TOLERANCE, Kind
from app.inference.networks.base import Checkpoint, Network
from app.inference.networks.compiled import CompiledNetwork
from app.inference.row_threads import RowThreads
from tests.inference.networks.conftest import CONDITION_SIZE, TIMES, RandomUNet, Read

COUNT = 37
THREADS = RowThreads(1)


class Arguments(NamedTuple):
    """Rows for a network, and the same for the checkpoint itself."""

    u_t: Tensor
    t: Tensor
    condition: Tensor
    keep: Tensor

    def embedding(self, network: Network) -> Tensor:
        """Embed each row's condition, kept or left out."""
        pairs = zip(self.condition, self.keep, strict=True)
        return torch.stack([network.embed(c)[0 if keep else 1] for c, keep in pairs])

    def predicted(self, network: Network) -> Tensor:
        return network.predict(self.u_t, self.t, self.embedding(network))

    def expected(self, checkpoint: Checkpoint) -> Tensor:
        noise: Tensor = checkpoint.script(self.u_t[:, None], self.t, self.condition, self.keep)
        return noise[:, 0]


def arguments(horizon: int = 64, count: int = COUNT) -> Arguments:
    generator = torch.Generator().manual_seed(horizon + count)
    return Arguments(
        torch.randn(count, horizon, generator=generator),
        torch.randint(TIMES, (count,), generator=generator),
        torch.randn(count, CONDITION_SIZE, generator=generator),
        torch.rand(count, generator=generator) < 0.5,
    )


@pytest.fixture(params=KINDS, ids=lambda kind: kind.__name__)
def kind(request: pytest.FixtureRequest) -> Kind:
    built: Kind = request.param
    return built


@pytest.fixture
def last_bits(kind: Kind) -> float:
    """How far a prediction may be from the same among other rows or on other threads."""
    return 0.0 if kind is CompiledNetwork else 1e-6


@pytest.fixture(scope="module")
def checkpoint(random_unet: RandomUNet, read: Read) -> Checkpoint:
    return read(random_unet())


@pytest.mark.parametrize("channels", [16, 32, 64, 80])
def test_it_predicts_what_the_checkpoint_does(
    kind: Kind, channels: int, random_unet: RandomUNet, read: Read
) -> None:
    unet = random_unet(channels)

    for horizon in (8, 16, 24, 40, 64):
        checkpoint, rows = read(unet, horizon), arguments(horizon)
        predicted, expected = rows.predicted(kind(checkpoint, THREADS)), rows.expected(checkpoint)
        assert expected.std() > 0.1
        torch.testing.assert_close(predicted, expected, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("count", [1, 2, 3, 8, 17, 100])
def test_any_number_of_rows_goes_through_on_any_number_of_threads(
    kind: Kind, threads: RowThreads, count: int, checkpoint: Checkpoint
) -> None:
    rows = arguments(count=count)

    predicted = rows.predicted(kind(checkpoint, threads))

    assert predicted.shape == (count, 64)
    assert predicted.dtype == torch.float32
    torch.testing.assert_close(predicted, rows.expected(checkpoint), rtol=0, atol=1e-5)


def test_a_row_is_the_same_alone_and_beside_others(
    kind: Kind, last_bits: float, threads: RowThreads, checkpoint: Checkpoint
) -> None:
    network, rows = kind(checkpoint, threads), arguments()
    together = rows.predicted(network)

    for row in range(COUNT):
        alone = Arguments(*(part[row : row + 1] for part in rows)).predicted(network)
        torch.testing.assert_close(alone, together[row : row + 1], rtol=0, atol=last_bits)


def test_the_number_of_threads_changes_nothing(
    kind: Kind, last_bits: float, threads: RowThreads, checkpoint: Checkpoint
) -> None:
    rows = arguments()

    torch.testing.assert_close(
        rows.predicted(kind(checkpoint, threads)),
        rows.predicted(kind(checkpoint, THREADS)),
        rtol=0,
        atol=last_bits,
    )


def test_the_null_condition_is_the_same_for_all_and_unlike_every_condition(
    kind: Kind, checkpoint: Checkpoint
) -> None:
    network, rows = kind(checkpoint, THREADS), arguments(count=2)
    both = [network.embed(condition) for condition in rows.condition]
    assert both[0].shape == both[1].shape
    assert len(both[0]) == 2

    def predicted(row: int, condition: int) -> Tensor:
        embedding = both[condition][row : row + 1]
        return network.predict(rows.u_t[:1], rows.t[:1], embedding)

    assert torch.equal(predicted(1, 0), predicted(1, 1))
    assert not torch.allclose(predicted(0, 0), predicted(0, 1))
    assert not torch.allclose(predicted(0, 0), predicted(1, 0))


def test_it_leaves_its_arguments_alone_and_gives_no_gradients_to_keep(
    kind: Kind, threads: RowThreads, checkpoint: Checkpoint
) -> None:
    network, rows = kind(checkpoint, threads), arguments()
    embedding = rows.embedding(network)
    copies = [part.clone() for part in (*rows[:2], embedding)]

    noise = network.predict(rows.u_t, rows.t, embedding)

    assert not noise.requires_grad
    for part, copy in zip((*rows[:2], embedding), copies, strict=True):
        assert torch.equal(part, copy)
