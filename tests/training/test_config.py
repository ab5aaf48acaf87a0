import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.planning.methods.sampler import PAPER_MODEL_SAMPLERS
from app.planning.plant.system import System
from app.planning.prior import ControlPrior
from tests.training.conftest import PLANS
from training.config import (
    DEFAULT_CONFIG,
    PlansConfig,
    TrainingConfig,
    TransitionsConfig,
    UNetConfig,
)


@pytest.fixture
def values() -> dict[str, Any]:
    return tomllib.loads(DEFAULT_CONFIG.read_text())


def test_the_default_configuration_is_that_of_the_paper() -> None:
    config = TrainingConfig.read(DEFAULT_CONFIG)

    assert config.system == System(
        static_friction=0.7,
        coulomb_friction=0.6,
        viscous_damping=0.05,
        control_limit=0.9,
        time_step=0.05,
        velocity_threshold=1e-3,
    )
    assert isinstance(config.data, TransitionsConfig)
    assert isinstance(config.network, UNetConfig)
    assert config.data.horizon == 64
    assert config.data.position_range == (-1.0, 1.0)
    assert config.data.velocity_range == (-0.5, 0.5)
    assert config.data.training_samples == 50_000
    assert config.data.validation_samples == 10_000
    assert config.diffusion.num_timesteps == 200
    assert config.diffusion.drop_probability == 0.2
    assert config.optimisation.batch_size == 256
    assert config.optimisation.steps == 15_000
    assert config.optimisation.learning_rate == 2e-3
    assert config.optimisation.ema_decay == 0.995
    assert config.optimisation.decay == "none"
    assert config.optimisation.terminal_weight == 0.0
    assert config.optimisation.max_gradient_norm is None
    assert config.diffusion.predicts == "noise"
    assert config.samplers == PAPER_MODEL_SAMPLERS
    assert config.network.channels == 64
    assert config.network.time_dimension == 64
    assert config.network.condition_dimension == 64


def test_the_default_prior_is_that_of_the_paper_and_of_the_baseline() -> None:
    prior = TrainingConfig.read(DEFAULT_CONFIG).prior

    assert prior == ControlPrior()
    assert prior.num_segments == 8
    assert prior.kick_minimum == 0.75
    assert prior.medium_maximum == 0.6
    assert prior.near_zero_maximum == 0.15
    assert prior.filter_coefficient == 0.3


@pytest.mark.parametrize(
    "section", ["", "system", "prior", "data", "network", "diffusion", "optimisation"]
)
def test_an_unknown_key_is_refused_by_its_name(values: dict[str, Any], section: str) -> None:
    (values[section] if section else values)["surprise"] = 1

    with pytest.raises(ValidationError, match="surprise"):
        TrainingConfig.model_validate(values)


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ("data", "horizon"),
        ("network", "channels"),
        ("diffusion", "num_timesteps"),
        ("optimisation", "steps"),
    ],
)
def test_a_missing_key_is_refused_by_its_name(
    values: dict[str, Any], section: str, key: str
) -> None:
    del values[section][key]

    with pytest.raises(ValidationError, match=key):
        TrainingConfig.model_validate(values)


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("system", "coulomb_friction", 0.8),
        ("system", "time_step", 0.0),
        ("system", "static_friction", float("nan")),
        ("prior", "kick_probability", 1.5),
        ("prior", "medium_probability", 0.7),
        ("data", "horizon", 63),
        ("data", "horizon", 0),
        ("data", "training_samples", 0),
        ("data", "position_range", [1.0, -1.0]),
        ("data", "velocity_range", [0.5, 0.5]),
        ("data", "velocity_range", [0.5]),
        ("data", "position_range", [0.0, float("inf")]),
        ("network", "channels", 12),
        ("network", "channels", 0),
        ("network", "time_dimension", 3),
        ("diffusion", "num_timesteps", 1),
        ("diffusion", "drop_probability", 1.0),
        ("optimisation", "steps", 0),
        ("optimisation", "batch_size", 50_001),
        ("optimisation", "learning_rate", 0.0),
        ("optimisation", "ema_decay", 1.0),
        ("optimisation", "validation_interval", 0),
    ],
)
def test_a_wrong_value_is_refused_with_its_section(
    values: dict[str, Any], section: str, key: str, value: object
) -> None:
    values[section][key] = value

    with pytest.raises(ValidationError, match=f"{section}|{key}"):
        TrainingConfig.model_validate(values)


@pytest.mark.parametrize(
    ("key", "value"),
    [("name", "../escape"), ("name", "With Space"), ("version", 0), ("seed", -1)],
)
def test_a_wrong_name_version_or_seed_is_refused(
    values: dict[str, Any], key: str, value: object
) -> None:
    values[key] = value

    with pytest.raises(ValidationError, match=key):
        TrainingConfig.model_validate(values)


def test_what_is_not_toml_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("name =")

    with pytest.raises(tomllib.TOMLDecodeError):
        TrainingConfig.read(tmp_path / "bad.toml")
    with pytest.raises(OSError, match="nowhere"):
        TrainingConfig.read(tmp_path / "nowhere.toml")


def test_a_file_says_what_differs_from_the_default(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('name = "own"\n[system]\nstatic_friction = 0.8\n')
    default, own = TrainingConfig.read(DEFAULT_CONFIG), TrainingConfig.read(tmp_path / "own.toml")

    assert own.name == "own"
    assert own.system == replace(default.system, static_friction=0.8)
    assert own.model_copy(update={"name": default.name, "system": default.system}) == default


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[system]\nstatic_friction = 0.8\n", "name"),
        ('name = "own"\n[systems]\nstatic_friction = 0.8\n', "systems"),
        ('name = "own"\n[system]\nstatic = 0.8\n', "static"),
        ('name = "own"\nsystem = 3\n', "system"),
    ],
)
def test_a_file_without_a_name_or_with_unknown_keys_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "own.toml").write_text(text)

    with pytest.raises(ValidationError, match=message):
        TrainingConfig.read(tmp_path / "own.toml")


def test_the_models_of_table_3_differ_in_static_friction_alone() -> None:
    default = TrainingConfig.read(DEFAULT_CONFIG)
    for static_friction in (0.6, 0.8):
        config = TrainingConfig.read(
            DEFAULT_CONFIG.with_name(f"dry-friction-fs{static_friction}.toml")
        )
        assert config.system == replace(default.system, static_friction=static_friction)
        assert config.model_copy(update={"name": default.name, "system": default.system}) == default


def test_a_section_of_another_kind_stands_for_itself(tmp_path: Path) -> None:
    """What the default says of transitions means nothing for plans."""
    config = TrainingConfig.read(DEFAULT_CONFIG.with_name("any-machine.toml"))

    assert isinstance(config.data, PlansConfig)
    assert config.data.experts.least_energy + config.data.experts.exact == 1.0
    (tmp_path / "own.toml").write_text('name = "own"\n[network]\nkind = "mlp"\nwidth = 64\n')
    with pytest.raises(ValidationError, match=r"network\.mlp\.blocks"):
        TrainingConfig.read(tmp_path / "own.toml")


def test_a_file_says_what_differs_from_its_base(tmp_path: Path) -> None:
    machines, longer, residual = (
        TrainingConfig.read(DEFAULT_CONFIG.with_name(f"{name}.toml"))
        for name in ("any-machine", "any-machine-robust-h128", "any-machine-mlp")
    )

    assert isinstance(machines.data, PlansConfig)
    assert isinstance(longer.data, PlansConfig)
    assert isinstance(residual.data, PlansConfig)
    assert (machines.data.horizon, longer.data.horizon) == (64, 128)
    assert longer.data.experts != machines.data.experts == residual.data.experts
    assert longer.samplers == machines.samplers == residual.samplers
    assert longer.network == residual.network
    assert (machines.network.kind, residual.network.kind) == ("unet", "mlp")
    for text, told in (('base = "nowhere.toml"', OSError), ('base = "own.toml"', ValidationError)):
        (tmp_path / "own.toml").write_text(f'name = "own"\n{text}\n')
        with pytest.raises(told, match=r"nowhere\.toml|base"):
            TrainingConfig.read(tmp_path / "own.toml")


def test_the_shares_of_experts_add_up_to_one(values: dict[str, Any]) -> None:
    values["data"] = PLANS | {"experts": PLANS["experts"] | {"rollout": 0.6}}

    with pytest.raises(ValidationError, match="add up to 1"):
        TrainingConfig.model_validate(values)


def test_the_terminal_loss_needs_plans(values: dict[str, Any]) -> None:
    values["optimisation"]["terminal_weight"] = 1.0

    with pytest.raises(ValidationError, match='terminal_weight is for data of the kind "plans"'):
        TrainingConfig.model_validate(values)


def test_the_learning_rate_falls_along_a_cosine(values: dict[str, Any]) -> None:
    values["optimisation"] |= {"decay": "cosine", "steps": 100, "learning_rate": 1.0}
    optimisation = TrainingConfig.model_validate(values).optimisation

    assert optimisation.learning_rate_at(0) == 1.0
    assert optimisation.learning_rate_at(50) == pytest.approx(0.51)
    assert optimisation.learning_rate_at(99) == pytest.approx(0.02, abs=1e-3)
