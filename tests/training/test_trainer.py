import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from tests.training.conftest import ANY_MACHINE
from training.batch import Batch
from training.config import TrainingConfig
from training.trainer import LossRecord, Trainer, TrainingInterrupted

CPU = torch.device("cpu")
Configure = Callable[..., TrainingConfig]

# Dies for good at the second save, half way through writing.
KILLED_WHILE_SAVING = """
import os, signal, sys
from pathlib import Path
import torch
from training import trainer
from tests.training.conftest import ANY_MACHINE
from training.config import TrainingConfig

saves = 0
save = torch.save

def save_or_die(state, file):
    global saves
    saves += 1
    if saves == 2:
        file.write(b"half a state")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
    save(state, file)

torch.save = save_or_die
torch.set_num_threads(int(sys.argv[3]))
trainer.SAVE_INTERVAL = 4
config = TrainingConfig.model_validate_json(sys.argv[1])
trainer.Trainer(config, Path(sys.argv[2]), torch.device("cpu")).run()
"""


class SignalAtRecord(logging.Handler):
    """Sends this process a signal when the trainer logs its losses."""

    def __init__(self, number: signal.Signals) -> None:
        super().__init__()
        self.number: signal.Signals | None = number

    def emit(self, record: logging.LogRecord) -> None:
        if self.number is not None and "validation loss" in record.getMessage():
            number, self.number = self.number, None
            os.kill(os.getpid(), number)


@pytest.fixture
def log() -> Iterator[logging.Logger]:
    """The log of training, as the command sets it up; put back afterwards."""
    logger = logging.getLogger("training")
    handlers, level = logger.handlers[:], logger.level
    logger.setLevel(logging.INFO)
    yield logger
    logger.handlers[:] = handlers
    logger.setLevel(level)


def train(config: TrainingConfig, directory: Path) -> Trainer:
    trainer = Trainer(config, directory, CPU)
    trainer.run()
    return trainer


def assert_same_outcome(trainer: Trainer, expected: Trainer) -> None:
    assert trainer.progress.step == expected.progress.step
    assert trainer.progress.history == expected.progress.history
    weights = trainer.averaged_network.state_dict()
    for name, tensor in expected.averaged_network.state_dict().items():
        assert torch.equal(weights[name], tensor), name


@pytest.fixture(scope="module")
def uninterrupted(configure: Configure, tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    return train(configure(), tmp_path_factory.mktemp("run"))


def test_losses_are_recorded_at_every_interval_and_at_the_end(uninterrupted: Trainer) -> None:
    history = uninterrupted.progress.history

    assert [record.step for record in history] == [5, 10, 12]
    assert all(record.training > 0 and record.validation > 0 for record in history)


def test_a_signal_is_not_held_up_by_the_first_plans(
    configure: Configure, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainer = Trainer(configure(**ANY_MACHINE), tmp_path, CPU)
    numbers = signal.SIGINT, signal.SIGTERM
    usual = [signal.getsignal(number) for number in numbers]

    def interrupted(_step: int) -> Batch:
        assert [signal.getsignal(number) for number in numbers] == usual
        raise KeyboardInterrupt

    monkeypatch.setattr(trainer.data, "batch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        trainer.run()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_interrupted_run_goes_on_to_bit_identical_weights(
    configure: Configure,
    tmp_path: Path,
    uninterrupted: Trainer,
    log: logging.Logger,
    number: signal.Signals,
) -> None:
    trainer = Trainer(configure(), tmp_path, CPU)
    log.addHandler(SignalAtRecord(number))
    handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]

    with pytest.raises(TrainingInterrupted, match="step 5"):
        trainer.run()

    assert trainer.progress.step == 5
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == handlers
    resumed = Trainer(configure(), tmp_path, CPU)
    assert resumed.progress.step == 5
    resumed.run()
    assert_same_outcome(resumed, uninterrupted)


def test_a_run_that_was_killed_while_saving_goes_on_to_bit_identical_weights(
    configure: Configure, tmp_path: Path, uninterrupted: Trainer
) -> None:
    arguments = [configure().model_dump_json(), str(tmp_path), str(torch.get_num_threads())]

    killed = subprocess.run(
        [sys.executable, "-c", KILLED_WHILE_SAVING, *arguments],
        capture_output=True,
        check=False,
        timeout=300,
    )

    assert killed.returncode == -signal.SIGKILL, killed.stderr.decode()
    resumed = Trainer(configure(), tmp_path, CPU)
    assert resumed.progress.step == 4
    resumed.run()
    assert_same_outcome(resumed, uninterrupted)


@pytest.mark.parametrize("predicts", ["clean", "velocity"])
def test_a_model_of_many_machines_learns_and_goes_on_where_it_was_stopped(
    configure: Configure, tmp_path: Path, log: logging.Logger, predicts: str
) -> None:
    config = configure(**ANY_MACHINE | {"diffusion": {"predicts": predicts}})
    uninterrupted = train(config, tmp_path / "whole")
    trainer = Trainer(config, tmp_path / "parts", CPU)
    log.addHandler(SignalAtRecord(signal.SIGTERM))
    with pytest.raises(TrainingInterrupted, match="step 5"):
        trainer.run()

    assert_same_outcome(train(config, tmp_path / "parts"), uninterrupted)
    history = uninterrupted.progress.history
    assert history[-1].validation < history[0].validation


def test_a_finished_run_is_found_finished(configure: Configure, tmp_path: Path) -> None:
    finished = train(configure(), tmp_path)

    again = train(configure(), tmp_path)

    assert_same_outcome(again, finished)


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"optimisation": {"steps": 13}},
        {"system": {"static_friction": 0.8}},
        {"prior": {"kick_probability": 0.5}},
    ],
    ids=["seed", "steps", "system", "prior"],
)
def test_a_run_directory_of_another_configuration_is_refused(
    configure: Configure, tmp_path: Path, change: dict[str, object]
) -> None:
    train(configure(), tmp_path)
    state = (tmp_path / "state.pt").read_bytes()

    with pytest.raises(ValueError, match="another configuration"):
        Trainer(configure(**change), tmp_path, CPU)

    assert (tmp_path / "state.pt").read_bytes() == state


def test_the_seed_decides_the_outcome(
    configure: Configure, tmp_path: Path, uninterrupted: Trainer
) -> None:
    assert_same_outcome(train(configure(), tmp_path / "same"), uninterrupted)

    other = train(configure(seed=1), tmp_path / "other")
    assert other.progress.history != uninterrupted.progress.history
    assert not torch.equal(
        other.averaged_network.input.weight, uninterrupted.averaged_network.input.weight
    )


def test_the_loss_falls(configure: Configure, tmp_path: Path) -> None:
    config = configure(
        data={"training_samples": 512},
        optimisation={"steps": 120, "validation_interval": 20, "batch_size": 64},
    )

    history = train(config, tmp_path).progress.history

    assert history[-1].training < 0.8 * history[0].training
    assert history[-1].validation < 0.8 * history[0].validation


def test_without_averaging_the_exported_weights_are_those_of_the_last_step(
    configure: Configure, tmp_path: Path
) -> None:
    """A decay of almost one instead holds on to the first weights."""

    def weights(decay: float, steps: int) -> torch.Tensor:
        config = configure(
            optimisation={"ema_decay": decay, "steps": steps, "validation_interval": steps}
        )
        return train(config, tmp_path / f"{decay}-{steps}").averaged_network.input.weight

    moved = (weights(0.0, 12) - weights(0.0, 1)).abs().max()
    held = (weights(0.999, 12) - weights(0.999, 1)).abs().max()
    assert held < 0.1 * moved


def test_training_stops_when_the_loss_is_not_finite(configure: Configure, tmp_path: Path) -> None:
    config = configure(optimisation={"learning_rate": 1e30})

    with pytest.raises(FloatingPointError, match="step"):
        train(config, tmp_path)


def test_records_survive_a_resume_as_they_were(configure: Configure, tmp_path: Path) -> None:
    history = train(configure(), tmp_path).progress.history

    resumed = Trainer(configure(), tmp_path, CPU).progress.history

    assert resumed == history
    assert all(isinstance(record, LossRecord) for record in resumed)
