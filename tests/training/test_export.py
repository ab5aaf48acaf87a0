import csv
import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from app.inference.device import CPU
from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE, Manifest
from app.inference.model_store import ModelStore
from app.inference.row_threads import RowThreads
from app.inference.torchscript import read_torchscript
from app.inference.verification import find_versions
from app.planning.plant.coverage import Coverage
from training.config import TrainingConfig
from training.export import export, version_directory
from training.trainer import Trainer

Configure = Callable[..., TrainingConfig]


@pytest.fixture(scope="module")
def trainer(configure: Configure, tmp_path_factory: pytest.TempPathFactory) -> Trainer:
    trainer = Trainer(configure(seed=3), tmp_path_factory.mktemp("run"), CPU)
    trainer.run()
    return trainer


@pytest.fixture
def log_file(tmp_path: Path) -> Path:
    path = tmp_path / "training.log"
    path.write_text("what happened\n")
    return path


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return tmp_path / "store"


@pytest.fixture
def published(trainer: Trainer, store: Path, log_file: Path) -> Path:
    return export(trainer, store, log_file)


def test_a_version_folder_holds_all_that_belongs_to_a_model(published: Path, store: Path) -> None:
    assert published == store / "tiny" / "1"
    assert sorted(path.name for path in published.iterdir()) == [
        "loss.csv",
        "loss.png",
        MANIFEST_FILE,
        "training.log",
        CHECKPOINT_FILE,
    ]
    assert (published / "training.log").read_text() == "what happened\n"
    assert (published / "loss.png").read_bytes().startswith(b"\x89PNG")
    assert list(store.rglob(".*")) == []


def test_the_manifest_tells_what_the_service_must_know(published: Path, trainer: Trainer) -> None:
    manifest = Manifest.read(published / MANIFEST_FILE)

    checkpoint = (published / CHECKPOINT_FILE).read_bytes()
    assert manifest.sha256 == hashlib.sha256(checkpoint).hexdigest()
    assert (manifest.name, manifest.version, manifest.horizon) == ("tiny", 1, 16)
    assert manifest.coverage == Coverage.only(trainer.config.system)
    assert manifest.system == trainer.config.system
    assert "Rollouts of random controls" in manifest.trained_on
    assert manifest.predicts == "noise"
    assert manifest.samplers == trainer.config.samplers
    assert manifest.format_version == 2
    assert manifest.condition == trainer.data.conditioning
    np.testing.assert_array_equal(manifest.alphas_cumprod, trainer.alphas_cumprod)
    assert manifest.seeds == {"training": 3}
    assert manifest.losses.validation == trainer.progress.history[-1].validation
    assert manifest.losses.training == trainer.progress.history[-1].training
    assert manifest.libraries["torch"] == torch.__version__


def test_the_configuration_in_the_manifest_trains_the_same_model(
    published: Path, trainer: Trainer
) -> None:
    manifest = Manifest.read(published / MANIFEST_FILE)

    assert TrainingConfig.model_validate(manifest.training) == trainer.config


def test_the_loss_curve_lists_every_record(published: Path, trainer: Trainer) -> None:
    with (published / "loss.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    assert [int(row["step"]) for row in rows] == [5, 10, 12]
    for row, record in zip(rows, trainer.progress.history, strict=True):
        assert float(row["training_loss"]) == pytest.approx(record.training, abs=1e-6)
        assert float(row["validation_loss"]) == pytest.approx(record.validation, abs=1e-6)


@pytest.mark.usefixtures("published")
def test_the_service_loads_what_was_published_with_the_averaged_weights(
    store: Path, trainer: Trainer
) -> None:
    network = ModelStore.load(store, CPU, RowThreads(1)).find("tiny/1").network

    torch.manual_seed(0)
    u_t, t, condition = torch.randn(4, 16), torch.tensor([0, 5, 10, 19]), torch.randn(4)
    keep = torch.tensor([True, True, False, False])
    with torch.inference_mode():
        torch.testing.assert_close(
            network.predict(u_t, t, network.embed(condition)[[0, 0, 1, 1]]),
            trainer.averaged_network(u_t.unsqueeze(1), t, condition.expand(4, -1), keep).squeeze(1),
            rtol=0,
            atol=1e-5,
        )


def test_a_published_version_is_never_changed(
    published: Path, trainer: Trainer, store: Path, log_file: Path
) -> None:
    before = {path: path.read_bytes() for path in published.iterdir()}

    with pytest.raises(FileExistsError, match="raise the version"):
        export(trainer, store, log_file)
    with pytest.raises(FileExistsError, match="raise the version"):
        version_directory(store, trainer.config)

    assert {path: path.read_bytes() for path in published.iterdir()} == before


def test_the_next_version_goes_beside_the_first(
    published: Path, configure: Configure, store: Path
) -> None:
    assert version_directory(store, configure(version=2)) == published.with_name("2")


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_an_export_that_fails_at_the_last_file_leaves_nothing_behind(
    trainer: Trainer,
    store: Path,
    log_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
) -> None:
    def fail(*_: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", fail)
        with pytest.raises(type(error)):
            export(trainer, store, log_file)

    assert [path for path in store.rglob("*") if path.is_file()] == []
    assert find_versions(store) == []
    # And it can be made up for.
    assert find_versions(store) == [] != [export(trainer, store, log_file)]


def test_a_reader_sees_no_version_until_it_is_whole(
    trainer: Trainer, store: Path, log_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[list[Path]] = []
    copy = shutil.copyfile

    def look_and_copy(source: Path, target: Path) -> Path:
        seen.append(find_versions(store))
        return copy(source, target)

    monkeypatch.setattr(shutil, "copyfile", look_and_copy)

    directory = export(trainer, store, log_file)

    assert seen == [[]]
    assert find_versions(store) == [directory]


def test_the_exported_file_is_a_torchscript_archive_for_the_cpu(published: Path) -> None:
    script = read_torchscript((published / CHECKPOINT_FILE).read_bytes(), CPU)

    assert {parameter.device.type for parameter in script.parameters()} == {"cpu"}
    assert not script.training
