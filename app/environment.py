"""The variables of the environment that are meant for this program.

An orchestrator makes more of the same kind: Kubernetes describes a service named `breakaway` to
every container beside it by BREAKAWAY_SERVICE_HOST, BREAKAWAY_PORT=tcp://10.0.0.7:8000 and others.
Standard library only, as the image's health check reads them every few seconds.
"""

import os
import re

PREFIX = "BREAKAWAY_"
INJECTED_NAME = re.compile(
    r"(.+_)?(service_host|service_port(_.+)?|port_\d+_(tcp|udp|sctp)(_(proto|port|addr))?)"
)
INJECTED_ADDRESS = re.compile(r"(tcp|udp|sctp)://.*")
"""The value of BREAKAWAY_PORT, and of BREAKAWAY_..._PORT for services with longer names."""


def own_variables() -> dict[str, str]:
    """Return the values of BREAKAWAY_*, by the rest of their names in lower case."""
    return {name: value for name, value in _variables().items() if not _is_injected(name, value)}


def injected_port() -> str | None:
    """Return the address that an orchestrator put where our port is looked for, if it did."""
    port = _variables().get("port")
    return port if port is not None and _is_injected("port", port) else None


def _variables() -> dict[str, str]:
    return {
        name.upper().removeprefix(PREFIX).lower(): value
        for name, value in os.environ.items()
        if name.upper().startswith(PREFIX)
    }


def _is_injected(name: str, value: str) -> bool:
    is_address = INJECTED_ADDRESS.fullmatch(value) is not None
    is_injected_port = is_address and (name == "port" or name.endswith("_port"))
    return is_injected_port or INJECTED_NAME.fullmatch(name) is not None
