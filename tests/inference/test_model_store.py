import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from app.inference import model as model_module
from app.inference.device import CPU
from app.inference.manifest import CHECKPOINT_FILE, MANIFEST_FILE
from app.inference.model import Model
from app.inference.model_card import GUESS, Pace
from app.inference.model_store import ModelStore, UnfitModel, UnknownModel
from app.inference.networks.compiled import CompiledNetwork
from app.inference.networks.scripted import ScriptedNetwork
from app.inference.pace import SIZES
from app.inference.row_threads import RowThreads
from app.inference.torchscript import read_torchscript, to_torchscript
from app.inference.verification import ModelRejected, find_versions, verify
from app.planning.plant.coverage import Coverage
from app.planning.plant.system import System
from app.settings import SHIPPED_MODELS
from tests.inference.fakes import HORIZON, FakeNetwork, fake_model
from training.config import UNetConfig
from training.unet import UNet

THREADS = RowThreads(1)
STIFF = System(static_friction=0.8)
STIFFER = System(static_friction=2.0)
WIDE = Coverage(
    Coverage.only(System()).ranges
    | {
        "static_forward": (2.0, 2.5),
        "static_backward": (2.0, 2.5),
        "lowest_control": (-3.0, -0.9),
        "highest_control": (0.9, 3.0),
    }
)


class AnswersShort(torch.nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return u[:, :, 1:]


class AddsUp(torch.nn.Module):
    """Takes its inputs into account, each and every one."""

    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:
        summand = t + torch.where(keep, condition[:, 0], 0.5)
        return u + summand[:, None, None]


class Fails(torch.nn.Module):
    def forward(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:  # noqa: ARG002
        return u.reshape(-1, 7, 11)


@pytest.fixture
def no_loading(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make any reading of a checkpoint by torch fail the test."""

    def load(*_: object, **__: object) -> None:
        pytest.fail("torch read the checkpoint")

    monkeypatch.setattr(torch.jit, "load", load)
    monkeypatch.setattr(torch, "load", load)


def assert_answers_as(model: Model, checkpoint: bytes) -> None:
    generator = torch.Generator().manual_seed(0)
    u_t, t = torch.randn(5, model.manifest.horizon, generator=generator), torch.arange(5)
    condition = torch.randn(4, generator=generator)
    keep = torch.tensor([True, False, True, False, True])
    original = read_torchscript(checkpoint, CPU)
    with torch.inference_mode():
        embedding = model.network.embed(condition)[[0, 1, 0, 1, 0]]
        torch.testing.assert_close(
            model.network.predict(u_t, t, embedding),
            original(u_t.unsqueeze(1), t, condition.expand(5, -1), keep).squeeze(1),
            rtol=0,
            atol=1e-5,
        )


def test_a_loaded_model_is_run_by_the_kernel_and_answers_as_the_checkpoint_does(
    store: Path,
    publish: Callable[..., Path],
    checkpoint: bytes,
    caplog: pytest.LogCaptureFixture,
) -> None:
    publish()

    (model,) = ModelStore.load(store, CPU, THREADS).models

    assert model.label == "tiny/1"
    assert isinstance(model.network, CompiledNetwork)
    assert not caplog.records
    assert_answers_as(model, checkpoint)


def test_the_shipped_models_are_run_by_the_kernel(caplog: pytest.LogCaptureFixture) -> None:
    models = ModelStore.load(SHIPPED_MODELS, CPU, THREADS).models

    assert "dry-friction-fs0.7/1" in [model.label for model in models]
    # MLPs run as TorchScript.
    others = ("learned-", "any-machine-robust-h128/")
    unets = [model for model in models if not model.label.startswith(others)]
    assert all(isinstance(model.network, CompiledNetwork) for model in unets)
    assert not caplog.records


@pytest.mark.parametrize(
    ("network", "horizon"),
    [
        (UNet(UNetConfig(kind="unet", channels=8, time_dimension=8, condition_dimension=8), 4), 64),
        (
            UNet(UNetConfig(kind="unet", channels=16, time_dimension=8, condition_dimension=8), 4),
            20,
        ),
    ],
    ids=["channels", "horizon"],
)
def test_a_network_that_the_kernel_cannot_run_is_run_as_it_is_with_a_warning(
    store: Path,
    publish: Callable[..., Path],
    caplog: pytest.LogCaptureFixture,
    network: torch.nn.Module,
    horizon: int,
) -> None:
    content = to_torchscript(network)
    publish(content=content, horizon=horizon)

    (model,) = ModelStore.load(store, CPU, THREADS).models

    (warning,) = caplog.records
    assert warning.levelname == "WARNING"
    assert "tiny runs as TorchScript" in warning.getMessage()
    assert_answers_as(model, content)


def test_a_network_of_another_make_is_run_as_it_is_without_a_warning(
    store: Path, publish: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    content = to_torchscript(AddsUp())
    publish(content=content)

    (model,) = ModelStore.load(store, CPU, THREADS).models

    assert not caplog.records
    assert_answers_as(model, content)


@pytest.mark.usefixtures("no_loading")
@pytest.mark.parametrize("position", [0, 1000, -1])
def test_a_changed_checkpoint_is_refused_before_torch_reads_it(
    store: Path, publish: Callable[..., Path], position: int
) -> None:
    file = publish() / CHECKPOINT_FILE
    content = bytearray(file.read_bytes())
    content[position] ^= 1
    file.write_bytes(content)

    with pytest.raises(ModelRejected, match="changed or damaged"):
        ModelStore.load(store, CPU, THREADS)


@pytest.mark.usefixtures("no_loading")
def test_a_truncated_checkpoint_is_refused_before_torch_reads_it(
    store: Path, publish: Callable[..., Path]
) -> None:
    file = publish() / CHECKPOINT_FILE
    file.write_bytes(file.read_bytes()[:-1])

    with pytest.raises(ModelRejected, match="changed or damaged"):
        ModelStore.load(store, CPU, THREADS)


@pytest.mark.usefixtures("no_loading")
def test_a_missing_checkpoint_is_refused(store: Path, publish: Callable[..., Path]) -> None:
    (publish() / CHECKPOINT_FILE).unlink()

    with pytest.raises(ModelRejected, match=CHECKPOINT_FILE):
        ModelStore.load(store, CPU, THREADS)


@pytest.mark.usefixtures("no_loading")
def test_an_invalid_manifest_is_refused_with_its_folder_and_field(
    store: Path, publish: Callable[..., Path]
) -> None:
    file = publish("broken", 4) / MANIFEST_FILE
    file.write_text(json.dumps(json.loads(file.read_text()) | {"horizon": 0}))

    with pytest.raises(ModelRejected, match=r"(?s)broken/4.*horizon"):
        ModelStore.load(store, CPU, THREADS)


@pytest.mark.usefixtures("no_loading")
@pytest.mark.parametrize(("name", "version"), [("other", "1"), ("tiny", "2")])
def test_a_manifest_of_another_model_or_version_is_refused(
    store: Path, publish: Callable[..., Path], name: str, version: str
) -> None:
    folder = publish()
    (store / name).mkdir(exist_ok=True)
    folder.rename(store / name / version)

    with pytest.raises(ModelRejected, match="manifest is of tiny/1"):
        ModelStore.load(store, CPU, THREADS)


def test_a_checkpoint_that_is_no_torchscript_is_refused(
    store: Path, publish: Callable[..., Path]
) -> None:
    publish(content=b"not a model")

    with pytest.raises(ModelRejected, match="does not run"):
        ModelStore.load(store, CPU, THREADS)


@pytest.mark.parametrize("module", [AnswersShort(), Fails()], ids=["wrong shape", "fails"])
def test_a_network_that_does_not_do_its_job_is_refused_when_it_is_warmed_up(
    store: Path, publish: Callable[..., Path], module: torch.nn.Module
) -> None:
    publish(content=to_torchscript(module))

    with pytest.raises(ModelRejected, match="does not run"):
        ModelStore.load(store, CPU, THREADS)


def test_one_bad_model_keeps_the_whole_store_from_loading(
    store: Path, publish: Callable[..., Path]
) -> None:
    publish("good")
    (publish("bad") / CHECKPOINT_FILE).write_bytes(b"")

    with pytest.raises(ModelRejected, match="bad"):
        ModelStore.load(store, CPU, THREADS)


def test_a_store_that_does_not_exist_is_refused_and_an_empty_one_is_not(store: Path) -> None:
    with pytest.raises(ModelRejected, match="not a directory"):
        ModelStore.load(store / "nowhere", CPU, THREADS)
    assert ModelStore.load(store, CPU, THREADS).models == []


def test_what_is_no_model_is_skipped_and_said_once(
    store: Path, publish: Callable[..., Path], caplog: pytest.LogCaptureFixture
) -> None:
    whole = publish("tiny", 1)
    (publish("tiny", 2) / MANIFEST_FILE).unlink()
    (store / "tiny" / ".export-abc" / "3").mkdir(parents=True)
    (store / "tiny" / ".export-abc" / "3" / MANIFEST_FILE).write_text("{")
    (store / "tiny" / "draft").mkdir()
    (store / "tiny" / "draft" / MANIFEST_FILE).write_text("{")
    (store / "tiny" / "01").mkdir()
    (store / "tiny" / "01" / MANIFEST_FILE).write_text("{")
    (store / "tiny" / "notes").mkdir()
    (store / "flat").mkdir()
    (store / "flat" / MANIFEST_FILE).write_text("{")
    (store / "README.md").write_text("about the models")

    assert find_versions(store) == [whole]
    models = ModelStore.load(store, CPU, THREADS)
    assert [model.label for model in models.models] == ["tiny/1"]
    skipped = (
        "flat (manifest.json belongs in the folder of a version), "
        "tiny/01 (a version is a number, from 1 on), tiny/2 (no manifest.json), "
        "tiny/draft (a version is a number, from 1 on)"
    )
    (warning,) = caplog.records
    assert warning.levelname == "WARNING"
    assert warning.getMessage() == f"skipped in the model store {store}: {skipped}"
    with pytest.raises(UnknownModel) as unknown:
        models.find("tiny/2")
    assert str(unknown.value) == f"no model 'tiny/2'; there are: tiny/1; skipped: {skipped}"


def test_verifying_returns_the_very_bytes_that_were_hashed(
    publish: Callable[..., Path], checkpoint: bytes
) -> None:
    manifest, content = verify(publish())

    assert content == checkpoint
    assert hashlib.sha256(content).hexdigest() == manifest.sha256


def test_loading_again_keeps_what_is_the_same_and_loads_what_is_new(
    store: Path, publish: Callable[..., Path], other_checkpoint: bytes
) -> None:
    publish("same")
    publish("gone")
    changed = publish("changed")
    before = ModelStore.load(store, CPU, THREADS)
    (store / "gone" / "1" / MANIFEST_FILE).unlink()
    shutil.rmtree(changed)
    publish("changed", content=other_checkpoint)
    publish("same", 2)

    after = ModelStore.load(store, CPU, THREADS, serving=before.models)

    assert [model.label for model in after.models] == ["changed/1", "same/2", "same/1"]
    assert after.find("same/1") is before.find("same/1")
    assert_answers_as(after.find("changed"), other_checkpoint)
    assert_answers_as(before.find("changed"), (store / "same" / "1" / CHECKPOINT_FILE).read_bytes())


def test_a_model_whose_checkpoint_was_damaged_since_is_refused_though_it_is_loaded(
    store: Path, publish: Callable[..., Path]
) -> None:
    folder = publish()
    before = ModelStore.load(store, CPU, THREADS)
    (folder / CHECKPOINT_FILE).write_bytes(b"damaged")

    with pytest.raises(ModelRejected, match="changed or damaged"):
        ModelStore.load(store, CPU, THREADS, serving=before.models)


def reload_untimed(store: Path, serving: list[Model]) -> ModelStore:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_module, "measure_pace", lambda *_: pytest.fail("timed a network"))
        return ModelStore.load(store, CPU, THREADS, serving=serving)


def test_a_model_that_comes_while_others_serve_takes_over_the_pace_of_one_like_it(
    store: Path, publish: Callable[..., Path], other_checkpoint: bytes
) -> None:
    publish("scripted", horizon=20)
    publish("serving")
    before = ModelStore.load(store, CPU, THREADS).models
    paced = [replace(model, pace=Pace(16 + i, 1e-5)) for i, model in enumerate(before)]
    publish("new", content=other_checkpoint)

    after = reload_untimed(store, paced)

    assert isinstance(after.find("scripted").network, ScriptedNetwork)
    assert after.find("new").pace == after.find("serving").pace == Pace(17, 1e-5)


def test_a_model_unlike_those_that_serve_gets_a_guess_and_is_not_timed(
    store: Path, publish: Callable[..., Path]
) -> None:
    publish("serving")
    serving = ModelStore.load(store, CPU, THREADS).models
    wide = UNet(UNetConfig(kind="unet", channels=32, time_dimension=8, condition_dimension=8), 4)
    publish("wider", content=to_torchscript(wide))
    publish("longer", horizon=32)
    publish("scripted", horizon=20)

    after = reload_untimed(store, serving)

    assert {after.find(name).pace for name in ("wider", "longer", "scripted")} == {GUESS}
    assert {model.pace for model in reload_untimed(store, []).models} == {GUESS}


def test_a_model_comes_with_its_pace(store: Path, publish: Callable[..., Path]) -> None:
    publish()

    (model,) = ModelStore.load(store, CPU, THREADS).models

    assert model.pace.rows_at_once in SIZES
    assert model.pace.seconds_per_row > 0


@pytest.fixture(scope="module")
def several(
    publisher: Callable[[Path], Callable[..., Path]], tmp_path_factory: pytest.TempPathFactory
) -> ModelStore:
    store = tmp_path_factory.mktemp("store")
    publish = publisher(store)
    publish("nominal", 1)
    publish("nominal", 2, horizon=32)
    publish("nominal", 10)
    publish("stiff", 1, coverage=Coverage.only(STIFF), system=STIFF)
    publish("wide", 1, coverage=WIDE, system=STIFFER)
    publish("zeta", 1)
    return ModelStore.load(store, CPU, THREADS)


def test_models_and_versions_live_side_by_side(several: ModelStore) -> None:
    assert {model.label for model in several.models} == {
        "nominal/1",
        "nominal/2",
        "nominal/10",
        "stiff/1",
        "wide/1",
        "zeta/1",
    }


@pytest.mark.parametrize(
    ("reference", "label"),
    [
        ("nominal", "nominal/10"),
        ("nominal/1", "nominal/1"),
        ("nominal/2", "nominal/2"),
        ("stiff", "stiff/1"),
    ],
)
def test_a_name_finds_the_latest_version_and_a_version_finds_itself(
    several: ModelStore, reference: str, label: str
) -> None:
    assert several.find(reference).label == label


@pytest.mark.parametrize("reference", ["nomin", "nominal/3", "nominal/", "/1", "", "nominal/1/1"])
def test_an_unknown_model_is_refused_and_those_that_exist_are_named(
    several: ModelStore, reference: str
) -> None:
    with pytest.raises(UnknownModel) as refusal:
        several.find(reference)

    message = str(refusal.value)
    assert repr(reference) in message
    assert all(model.label in message for model in several.models)


@pytest.mark.parametrize(
    ("system", "horizon", "label"),
    [
        (System(), 64, "nominal/10"),
        (System(), 32, "nominal/2"),
        (STIFF, 64, "stiff/1"),
        (System(static_friction=2.0), 64, "wide/1"),
        (System(static_friction=2.3, control_limit=3.0), 64, "wide/1"),
    ],
)
def test_the_first_model_that_covers_plant_and_horizon_is_found(
    several: ModelStore, system: System, horizon: int, label: str
) -> None:
    assert several.covering(system, horizon).label == label


def test_for_a_plant_that_may_be_off_the_first_model_that_knows_of_such_is_found() -> None:
    uncertainty = {"coulomb_friction": 0.2}
    knowing = [fake_model(FakeNetwork(), name, uncertainty=uncertainty) for name in ("b", "c")]
    models = ModelStore([fake_model(FakeNetwork(), "a"), *knowing])

    assert models.covering(System(), HORIZON, may_be_off=True).label == "b/1"
    assert models.covering(System(), HORIZON).label == "a/1"
    nominal = ModelStore([fake_model(FakeNetwork(), "a")])
    assert nominal.covering(System(), HORIZON, may_be_off=True).label == "a/1"


@pytest.mark.parametrize(
    ("system", "horizon"),
    [(System(), 65), (STIFF, 32), (System(static_friction=0.7000001), 64)],
)
def test_where_no_model_covers_it_those_that_exist_are_named_with_what_they_cover(
    several: ModelStore, system: System, horizon: int
) -> None:
    with pytest.raises(UnfitModel) as refusal:
        several.covering(system, horizon)

    message = str(refusal.value)
    assert message.startswith(f"no model was trained for this plant and horizon {horizon}")
    for model in several.models:
        assert f"{model.label} for plants with {model.manifest.coverage}" in message


def test_an_empty_store_says_that_there_are_none(store: Path) -> None:
    models = ModelStore.load(store, CPU, THREADS)

    with pytest.raises(UnknownModel, match="there are: none"):
        models.find("tiny")
    with pytest.raises(UnfitModel, match="there are: none"):
        models.covering(System(), 64)
