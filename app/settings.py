"""The service's settings, each from a BREAKAWAY_* variable or an option of `breakaway serve`.

Their descriptions are the command's help; settings_options.py reads variables and options.
"""

from ipaddress import ip_network
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    SecretStr,
    StringConstraints,
)

SHIPPED_MODELS = Path(__file__).resolve().parents[1] / "model_store"
"""Installed beside the package, so that the shipped models are found from any directory."""

PLAN_SETTINGS = (
    "model_store",
    "max_candidates",
    "max_horizon",
    "max_network_rows",
    "max_rollout_steps",
    "max_candidate_steps",
    "max_answer_numbers",
    "max_deadline_ms",
)
"""What a plan depends on, with and without a server."""

T = TypeVar("T")
LogFormat: TypeAlias = Literal["auto", "text", "json"]
Listed = Annotated[
    tuple[T, ...],
    BeforeValidator(
        lambda value: (
            [part for text in value.split(",") if (part := text.strip())]
            if isinstance(value, str)
            else value
        )
    ),
]
"""In text, separated by commas."""
Origin = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9+.-]*://[^/*\s]+$")]
PublicPath = Annotated[str, StringConstraints(pattern=r"^/")]
RootPath = Annotated[
    str,
    StringConstraints(pattern=r"^(/[A-Za-z0-9._~-]+)*/?$"),
    AfterValidator(lambda path: path.rstrip("/")),
]
IN_ANY_CASE = BeforeValidator(lambda value: value.lower() if isinstance(value, str) else value)


def _check_proxy(proxy: str) -> str:
    if proxy != "*":
        ip_network(proxy)
    return proxy


Proxy = Annotated[str, AfterValidator(_check_proxy)]


class Settings(BaseModel):
    """Address, limits and keys of a service."""

    model_config = ConfigDict(extra="forbid", validate_default=True)

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one.")
    model_store: Path = Field(SHIPPED_MODELS, description="Folder of the models.")
    log_level: Annotated[Literal["debug", "info", "warning", "error"], IN_ANY_CASE] = Field(
        "info", description="Least severe messages to log."
    )
    log_format: Annotated[LogFormat, IN_ANY_CASE] = Field(
        "auto", description="Lines for people, or JSON; auto is JSON where there is no terminal."
    )
    api_keys: SecretStr | None = Field(
        None,
        description="Keys that clients need, separated by commas; without any, the service is "
        "open. Rather in the environment or a file: others on the machine can read flags.",
    )
    api_keys_file: Path | None = Field(
        None, description="File with more such keys, one on each line; # begins a comment line."
    )
    public_paths: Listed[PublicPath] = Field(
        ("/livez", "/readyz", "/", "/playground/*"),
        description="Paths that need no key; /folder/* stands for all below it. The playground "
        "asks its user for one.",
    )
    cors_origins: Listed[Origin] = Field(
        (), description="Origins whose web pages may use the service, like https://example.org."
    )
    root_path: RootPath = Field(
        "",
        description="Path under which a proxy offers the service, like /planner; requests may come "
        "with it and without.",
    )
    trusted_proxies: Listed[Proxy] = Field(
        ("127.0.0.1", "::1"),
        description="Addresses and networks (10.0.0.0/8) of proxies whose X-Forwarded-For and "
        "X-Forwarded-Proto are believed; * for all.",
    )
    header_timeout_s: PositiveFloat = Field(
        10.0, description="Longest time until a request's head is complete, in seconds."
    )
    body_timeout_s: PositiveFloat = Field(
        30.0, description="Longest time from a request's head to the end of its body, in seconds."
    )
    send_timeout_s: PositiveFloat = Field(
        30.0,
        description="How long a client may leave lying what is sent to it, in seconds; then it is "
        "dropped.",
    )
    idle_timeout_s: PositiveInt = Field(
        75, description="How long a connection is kept between requests, in seconds."
    )
    max_body_bytes: PositiveInt = Field(
        65_536, description="Largest request body, but for those of a log and of a batch."
    )
    max_log_bytes: PositiveInt = Field(
        4_194_304, description="Largest request body of POST /identify."
    )
    max_batch_body_bytes: PositiveInt = Field(
        8_388_608, description="Largest request body of POST /plan_batch."
    )
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
        256, description="Most requests at work or waiting; more are answered 429."
    )
    max_pending_rows: PositiveInt = Field(
        2_000_000, description="Most rows through the network that all of them together still need."
    )
    max_pending_rollout_steps: PositiveInt = Field(
        4_000_000_000, description="Most time steps that all of them together simulate."
    )
    max_pending_answer_bytes: PositiveInt = Field(
        250_000_000,
        description="Most bytes of answers that are made and not yet sent; more are answered 429.",
    )
    max_sessions: PositiveInt = Field(
        128, description="Most control sessions at once; more are answered 429."
    )
    session_idle_timeout_s: PositiveFloat = Field(
        60.0, description="A control session that says nothing for so long is ended, in seconds."
    )
    max_deadline_ms: PositiveInt = Field(
        300_000,
        description="Longest deadline of a request, and that of one that names none, in "
        "milliseconds; what cannot be done by then is refused with 429.",
    )
    admin: bool = Field(
        False, description="Open POST /admin/reload, which loads what is new in the model store."
    )
