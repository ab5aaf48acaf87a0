"""The training loop: resumable at any step, and the same weights however often it was stopped.

Every random draw of step n comes from a generator seeded by (seed, purpose, n), so a step needs
nothing from the one before it but the weights and the optimiser's state (streams.py).
"""

import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from pickle import UnpicklingError
from time import perf_counter

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from tqdm import tqdm

from app.inference.noise_levels import noise_levels
from training.acceleration import accelerated
from training.batch import Batch, Data
from training.config import PlansConfig, TrainingConfig
from training.files import write_atomically
from training.network import Denoiser, build_network
from training.plan_store import PlanStore
from training.plans import PlanData
from training.schedule import alphas_cumprod
from training.start import StartingPoint
from training.streams import Stream, generator
from training.terminal_loss import TerminalLoss
from training.transitions import TransitionData

SAVE_INTERVAL = 250
VALIDATION_BATCH = 1000

log = logging.getLogger("training")


class TrainingInterrupted(Exception):
    """A signal asked the run to stop; its state is saved."""


@dataclass(frozen=True, slots=True)
class LossRecord:
    """Mean training loss since the record before, and the loss of the averaged weights."""

    step: int
    training: float
    validation: float


@dataclass(slots=True)
class Progress:
    """Where a run stands, weights aside."""

    step: int = 0
    loss_sum: float = 0.0
    """Of the training losses since the last record."""
    history: list[LossRecord] = field(default_factory=list)


class Trainer:
    """One training run: data, network, optimiser, averaged weights and progress.

    Args:
        config: decides everything.
        run_directory: holds the run's state; an existing one is resumed. Plans are kept beside it.
        device: where the network runs; the random draws are the same everywhere.

    Raises:
        ValueError: the run directory belongs to another configuration, or is damaged; or training
            cannot start from the model that it is to start from.
    """

    def __init__(self, config: TrainingConfig, run_directory: Path, device: torch.device) -> None:
        self.config = config
        self.device = device
        self._state_file = run_directory / "state.pt"

        start = StartingPoint.of(config.start) if config.start else None
        self.data = _data(config, device, run_directory.parent, start)
        kind = config.diffusion.kind
        self.alphas_cumprod = alphas_cumprod(kind, config.diffusion.num_timesteps)
        levels = noise_levels(kind, self.alphas_cumprod.tolist())
        self._levels = torch.tensor(levels, dtype=torch.float32, device=device)

        torch.manual_seed(int(self._rng(Stream.WEIGHTS).integers(2**63)))
        sizes = (self.data.conditioning.size, config.data.horizon)
        self._network = build_network(config.network, *sizes).to(device)
        if start:
            start.fill(self._network)
        self._forward = accelerated(self._network, device, config.optimisation.steps)
        self._optimiser = torch.optim.Adam(self._network.parameters(), fused=True)
        average = get_ema_multi_avg_fn(  # type: ignore[no-untyped-call]
            config.optimisation.ema_decay
        )
        self._average = AveragedModel(self._network, multi_avg_fn=average)
        self.progress = Progress()
        if self._state_file.exists():
            self._load()

    @property
    def averaged_network(self) -> Denoiser:
        """The network with averaged weights, for export."""
        network = self._average.module
        assert isinstance(network, Denoiser)
        return network

    def run(self) -> None:
        """Train to the last step, with a progress bar; log and record at every validation.

        Raises:
            TrainingInterrupted: SIGINT or SIGTERM came; the state is saved.
            FloatingPointError: the loss is not finite any more.
        """
        with closing(self.data):
            if self.progress.step < self.config.optimisation.steps:
                # The first plans take minutes, and there is nothing yet that a signal must save.
                self.data.batch(self.progress.step)
            self._run()

    def _run(self) -> None:
        optimisation = self.config.optimisation
        progress = self.progress
        first, started = progress.step, perf_counter()
        with (
            _signals_noticed() as signals,
            tqdm(total=optimisation.steps, initial=progress.step, unit="step", disable=None) as bar,
        ):
            while progress.step < optimisation.steps:
                loss = self._step(progress.step)
                progress.step += 1
                progress.loss_sum += loss
                bar.update()
                bar.set_postfix(loss=f"{loss:.4f}", refresh=False)
                last = progress.step == optimisation.steps
                if last or progress.step % optimisation.validation_interval == 0:
                    self._record((progress.step - first) / (perf_counter() - started))
                if last or signals or progress.step % SAVE_INTERVAL == 0:
                    self._save()
                if signals and not last:
                    raise TrainingInterrupted(f"stopped at step {progress.step}, state saved")

    def _rng(self, stream: Stream, index: int = 0) -> np.random.Generator:
        return generator(self.config.seed, stream, index)

    def _loss(
        self, network: Callable[..., Tensor], batch: Batch, rng: np.random.Generator
    ) -> Tensor:
        """Mean-squared error of the prediction, conditions dropped (paper, Eqs. 2 and 3).

        With the terminal loss of the clean sequence that it amounts to, where that has a weight.
        """
        controls = batch.controls
        rows = len(controls)
        diffusion, weight = self.config.diffusion, self.config.optimisation.terminal_weight
        t = torch.from_numpy(rng.integers(diffusion.num_timesteps, size=rows)).to(self.device)
        keep = torch.from_numpy(rng.random(rows) >= diffusion.drop_probability).to(self.device)
        noise_draw = rng.standard_normal(tuple(controls.shape), dtype=np.float32)
        noise = torch.from_numpy(noise_draw).to(self.device)
        levels = self._levels[t].view(-1, 4, 1, 1)
        signal_share, noise_share, signal_rate, noise_rate = levels.unbind(1)
        noisy = signal_share * controls + noise_share * noise
        if diffusion.kind == "regression":
            noisy = torch.zeros_like(noisy)
        predicted = network(noisy, t, batch.conditions, keep)
        match diffusion.predicts:
            case "noise":
                target = noise
            case "clean":
                target = controls
            case "velocity":
                target = noise_rate * noise + signal_rate * controls
        loss = nn.functional.mse_loss(predicted, target)
        if weight and batch.tasks:
            match diffusion.predicts:
                case "noise":
                    clean = (noisy - noise_share * predicted) / signal_share
                case "clean":
                    clean = predicted
                case "velocity":
                    clean = noise_rate * noisy - noise_share * predicted
            terminal: Tensor = TerminalLoss.apply(clean.squeeze(1), batch.tasks, keep, rng)  # type: ignore[no-untyped-call]
            loss = loss + weight * terminal
        return loss

    def _step(self, step: int) -> float:
        """Take optimiser step number `step` (from 0); return its loss."""
        optimisation = self.config.optimisation
        for group in self._optimiser.param_groups:
            group["lr"] = optimisation.learning_rate_at(step)
        loss = self._loss(self._forward, self.data.batch(step), self._rng(Stream.STEP, step))
        self._optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        if optimisation.max_gradient_norm:
            nn.utils.clip_grad_norm_(self._network.parameters(), optimisation.max_gradient_norm)
        self._optimiser.step()
        self._average.update_parameters(self._network)
        value = loss.item()
        if not np.isfinite(value):
            raise FloatingPointError(f"the loss is {value} at step {step}")
        return value

    @torch.no_grad()
    def _validate(self) -> float:
        """Return the loss of the averaged weights on the held-out set, with the same draws ever."""
        total = 0.0
        held_out = self.data.validation
        for number, start in enumerate(range(0, len(held_out), VALIDATION_BATCH)):
            batch = held_out.rows(slice(start, start + VALIDATION_BATCH))
            rng = self._rng(Stream.VALIDATION, number)
            total += self._loss(self._average.module, batch, rng).item() * len(batch)
        return total / len(held_out)

    def _record(self, steps_per_second: float) -> None:
        progress = self.progress
        previous = progress.history[-1].step if progress.history else 0
        training = progress.loss_sum / (progress.step - previous)
        record = LossRecord(progress.step, training, self._validate())
        progress.history.append(record)
        progress.loss_sum = 0.0
        log.info(
            "step %d/%d training loss %.5f validation loss %.5f (%.2f steps/s)",
            record.step,
            self.config.optimisation.steps,
            record.training,
            record.validation,
            steps_per_second,
        )

    def _save(self) -> None:
        state = {
            "config": self.config.same_training(),
            "step": self.progress.step,
            "loss_sum": self.progress.loss_sum,
            "history": [(r.step, r.training, r.validation) for r in self.progress.history],
            "network": self._network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "average": self._average.state_dict(),
        }
        write_atomically(self._state_file, lambda file: torch.save(state, file))

    def _load(self) -> None:
        try:
            state = torch.load(self._state_file, map_location=self.device, weights_only=True)
        except (RuntimeError, EOFError, UnpicklingError) as error:
            raise ValueError(f"{self._state_file} is damaged; delete it: {error}") from error
        if state["config"] != self.config.same_training():
            raise ValueError(
                f"{self._state_file} belongs to a run with another configuration; "
                "delete it or choose another run directory"
            )
        self._network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._average.load_state_dict(state["average"])
        self.progress = Progress(
            state["step"], state["loss_sum"], [LossRecord(*row) for row in state["history"]]
        )
        log.info("resumed at step %d", self.progress.step)


def _data(
    config: TrainingConfig, device: torch.device, plans: Path, start: StartingPoint | None
) -> Data:
    if isinstance(config.data, PlansConfig):
        store = PlanStore(config, config.data, plans)
        return PlanData(config, config.data, device, store, start.conditioning if start else None)
    return TransitionData(config, config.data, device)


@contextmanager
def _signals_noticed() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in the yielded list instead of acting on them."""
    received: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield received
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
