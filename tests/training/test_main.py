import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from app.inference.manifest import Manifest
from app.inference.model_store import ModelStore
from app.inference.row_threads import RowThreads
from app.planning.plant.system import System

CONFIG = """
name = "tiny"
version = 2
seed = 5
[system]
static_friction = 0.8
[prior]
[data]
kind = "transitions"
horizon = 16
training_samples = 64
validation_samples = 32
position_range = [-1.0, 1.0]
velocity_range = [-0.5, 0.5]
[network]
kind = "unet"
channels = 8
time_dimension = 8
condition_dimension = 8
[diffusion]
num_timesteps = 20
drop_probability = 0.2
predicts = "noise"
[optimisation]
steps = 6
batch_size = 16
learning_rate = 2e-3
decay = "none"
ema_decay = 0.9
terminal_weight = 0.0
validation_interval = 3
"""


def train(folder: Path, config: str) -> subprocess.CompletedProcess[str]:
    (folder / "config.toml").write_text(config)
    return subprocess.run(
        [
            *(sys.executable, "-m", "training"),
            *("--config", str(folder / "config.toml")),
            *("--model-store", str(folder / "store")),
            *("--run-directory", str(folder / "run")),
        ],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def test_a_configuration_becomes_a_model_that_the_service_loads(tmp_path: Path) -> None:
    result = train(tmp_path, CONFIG)

    assert result.returncode == 0, result.stderr
    directory = tmp_path / "store" / "tiny" / "2"
    assert result.stdout.splitlines() == [str(directory)]
    log = (directory / "training.log").read_text()
    assert re.search(r"step 6/6 training loss \d\.\d+ validation loss \d\.\d+", log)
    manifest = Manifest.read(directory / "manifest.json")
    assert manifest.covers(System(static_friction=0.8), 16)
    assert not manifest.covers(System(), 16)
    assert manifest.seeds == {"training": 5}
    (model,) = ModelStore.load(tmp_path / "store", torch.device("cpu"), RowThreads(1)).models
    assert model.label == "tiny/2"


@pytest.mark.slow
def test_a_published_version_is_refused_before_any_training(tmp_path: Path) -> None:
    (tmp_path / "store" / "tiny" / "2").mkdir(parents=True)

    result = train(tmp_path, CONFIG)

    assert result.returncode == 1
    assert "raise the version" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_wrong_value_is_refused_by_name_without_a_traceback(tmp_path: Path) -> None:
    result = train(tmp_path, CONFIG.replace("channels = 8", "channels = 9"))

    assert result.returncode == 1
    assert "network.channels" in result.stderr
    assert "Traceback" not in result.stderr
