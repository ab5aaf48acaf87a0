"""The service's settings: every flag of `breakaway serve` has a BREAKAWAY_* twin."""

from pathlib import Path
from typing import Literal

from pydantic import Field, PositiveInt
from pydantic_settings import BaseSettings, SettingsConfigDict

SHIPPED_MODELS = Path(__file__).resolve().parents[1] / "model_store"
"""Installed beside the package, so that the shipped models are found from any directory."""


class Settings(BaseSettings):
    """Serve plans over HTTP."""

    model_config = SettingsConfigDict(
        env_prefix="BREAKAWAY_",
        cli_prog_name="breakaway serve",
        cli_kebab_case=True,
        cli_avoid_json=True,
        cli_hide_none_type=True,
    )

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    model_store: Path = Field(SHIPPED_MODELS, description="Folder of the models.")
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="Least severe messages to log."
    )
    max_body_bytes: PositiveInt = Field(65_536, description="Largest request body.")
    max_candidates: PositiveInt = Field(4096, description="Largest K of a request.")
    max_horizon: PositiveInt = Field(1024, description="Most time steps of a plan.")
    max_network_rows: PositiveInt = Field(
        500_000,
        description="Most rows that a request may send through the network: K times network "
        "evaluations, over all targets.",
    )
    max_rollout_steps: PositiveInt = Field(
        2_000_000_000,
        description="Most time steps that a request may simulate: rollouts times horizon, over "
        "all targets.",
    )
    max_candidate_steps: PositiveInt = Field(
        2_500_000,
        description="Most time steps of candidates that a request may hold in memory: K times "
        "horizon, over all targets.",
    )
    max_answer_numbers: PositiveInt = Field(
        1_000_000, description="Most numbers of candidates that a request may ask to be sent."
    )
    max_pending: PositiveInt = Field(
        64, description="Most requests at work or waiting; more are answered 429."
    )
