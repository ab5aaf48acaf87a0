"""Which variables are ours, beside those that Kubernetes makes of a service of our name."""

import pytest

from app.environment import injected_port, own_variables

INJECTED = {
    "BREAKAWAY_SERVICE_HOST": "10.0.0.7",
    "BREAKAWAY_SERVICE_PORT": "8000",
    "BREAKAWAY_SERVICE_PORT_HTTP": "8000",
    "BREAKAWAY_PORT": "tcp://10.0.0.7:8000",
    "BREAKAWAY_PORT_8000_TCP": "tcp://10.0.0.7:8000",
    "BREAKAWAY_PORT_8000_TCP_PROTO": "tcp",
    "BREAKAWAY_PORT_8000_TCP_PORT": "8000",
    "BREAKAWAY_PORT_8000_TCP_ADDR": "10.0.0.7",
    "BREAKAWAY_PORT_9000_UDP": "udp://10.0.0.7:9000",
    # Of a service named breakaway-canary.
    "BREAKAWAY_CANARY_SERVICE_HOST": "10.0.0.8",
    "BREAKAWAY_CANARY_PORT": "tcp://10.0.0.8:8000",
    "BREAKAWAY_CANARY_PORT_8000_TCP_ADDR": "10.0.0.8",
}
"""As Kubernetes describes them for the container beside which the services run."""


def set_all(monkeypatch: pytest.MonkeyPatch, variables: dict[str, str]) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)


def test_none_that_is_injected_is_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    set_all(monkeypatch, INJECTED | {"BREAKAWAY_MAX_PENDING": "3"})
    assert own_variables() == {"max_pending": "3"}
    assert injected_port() == "tcp://10.0.0.7:8000"


def test_a_port_of_the_pod_s_own_goes_before_the_injected_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_all(monkeypatch, INJECTED | {"BREAKAWAY_PORT": "9000"})
    assert own_variables() == {"port": "9000"}
    assert injected_port() is None


def test_what_only_looks_similar_is_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    similar = {"BREAKAWAY_PRT": "tcp://10.0.0.7:8000", "BREAKAWAY_API_PORT": "9000"}
    set_all(monkeypatch, similar | {"BREAKAWAY_SERVICE": "10.0.0.7"})
    assert own_variables().keys() == {"prt", "api_port", "service"}


def test_case_does_not_matter_and_other_programs_are_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_all(monkeypatch, {"breakaway_port": "9000", "MY_BREAKAWAY_PORT": "1", "BREAKAWAYS": "2"})
    assert own_variables() == {"port": "9000"}
