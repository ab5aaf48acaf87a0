"""The list of models."""

from pathlib import Path

from app.planning.plant.machines import MACHINES
from app.settings import SHIPPED_MODELS
from tests.cli.command import invoke, run


def test_it_lists_the_shipped_models_from_any_directory(tmp_path: Path) -> None:
    done = run("models", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for manifest in SHIPPED_MODELS.glob("*/*/manifest.json"):
        assert manifest.parent.parent.name in done.stdout
    words = " ".join(done.stdout.split())
    assert "dry-friction-fs0.7/1: plants with static_friction 0.7, coulomb_friction 0.6," in words
    assert "Trained on: Rollouts of random controls" in words
    assert "By default: dpm_solver with 3 steps, s = 2, ddim with 10 steps, s = 1.5." in words
    assert "…" not in done.stdout


def test_it_lists_the_machines_and_who_published_them() -> None:
    done = invoke("models", "--machines", BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert max(map(len, lines)) <= 100
    assert "…" not in done.stdout
    for name, machine in MACHINES.items():
        (row,) = [line.split() for line in lines if line.startswith(f"{name} ")]
        assert row[-1] == f"{machine.system.time_step:g}"
        assert f"\n{name}: {machine.title}." in done.stdout
        assert machine.source.split()[-1] in done.stdout
    assert "emps             0.254/0.26  0.212/0.217  1.75/2.53" in done.stdout


def test_an_unfinished_model_is_said_to_be_skipped(tmp_path: Path) -> None:
    (tmp_path / "young" / "1").mkdir(parents=True)
    done = invoke("models", BREAKAWAY_MODEL_STORE=str(tmp_path))
    assert done.exit_code == 0
    assert done.stderr == "skipped: young/1 (no manifest.json)\n"


def test_a_tampered_model_is_named(tampered_store: Path) -> None:
    done = invoke("models", BREAKAWAY_MODEL_STORE=str(tampered_store))
    assert done.exit_code == 1
    assert "tiny/1/unet.pt: sha256" in done.stderr


def test_a_missing_store_is_said() -> None:
    done = invoke("models", BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert done.stderr == "the model store nowhere is not a directory\n"
