"""What is wrong with a value that may be of several kinds is told once, and at its place."""

from typing import Any

import pytest
from pydantic import ValidationError

from app.wire.field_errors import field_errors
from app.wire.requests import PlanRequest

EITHER_WAY = "must be a number, or an object with forward and backward"
MACHINES = "'paper', 'emps', 'belt_cart', 'cart_pole', 'rack_and_pinion', 'servo'"


def faults(**fields: Any) -> dict[str, str]:
    """Return the details of a request's errors by their pointers, which are all different."""
    body = {"initial_state": [0, 0], "target_state": [0.2, 0], "method": "cem"} | fields
    with pytest.raises(ValidationError) as raised:
        PlanRequest.model_validate(body)
    found = field_errors(raised.value.errors(), body)
    details = {error.pointer: error.detail for error in found}
    assert len(details) == len(found)
    return details


@pytest.mark.parametrize("value", ["0.6", True, None, [], [1, 2], "emps"])
@pytest.mark.parametrize("name", ["static_friction", "coulomb_friction", "viscous_damping"])
def test_what_is_neither_number_nor_object_gets_one_error(name: str, value: Any) -> None:
    assert faults(system={name: value}) == {f"/system/{name}": EITHER_WAY}


def test_limits_are_named_by_their_own_keys() -> None:
    detail = "must be a number, or an object with lower and upper"
    assert faults(system={"control_limit": "1"}) == {"/system/control_limit": detail}


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        ({"coulomb_friction": -1}, {"/coulomb_friction": "greater than or equal to 0"}),
        ({"coulomb_friction": 2e6}, {"/coulomb_friction": "less than or equal to 1000000"}),
        ({"control_limit": 0}, {"/control_limit": "greater than or equal to 0.000001"}),
        ({"static_friction": float("nan")}, {"/static_friction": "NaN is not a finite number"}),
        (
            {"coulomb_friction": {"forward": True, "backward": "0.9", "sideways": 1}},
            {
                "/coulomb_friction/forward": "a valid number",
                "/coulomb_friction/backward": "a valid number",
                "/coulomb_friction/sideways": "Unexpected",
            },
        ),
        ({"static_friction": {"forward": 1}}, {"/static_friction/backward": "Field required"}),
        ({"static_friction": {}},
         {"/static_friction/forward": "required", "/static_friction/backward": "required"}),
        (
            {"viscous_damping": {"forward": float("inf"), "backward": 1}},
            {"/viscous_damping/forward": "Infinity is not a finite number"},
        ),
        ({"control_limit": {"lower": 1, "upper": 1}}, {"/control_limit": "upper must exceed"}),
        ({"control_limit": {"lower": 2, "upper": -2}}, {"/control_limit": "upper must exceed"}),
        (
            {"static_friction": {"forward": 0.7, "backward": 0.5}},
            {"": "coulomb_friction must not exceed static_friction backward"},
        ),
        (
            {"viscous_damping": {"forward": 20, "backward": 1}},
            {"": "viscous_damping * time_step must be below 1 forward"},
        ),
        ({"stribeck_velocity": 0}, {"/stribeck_velocity": "greater than or equal"}),
        (
            {"bias": "no", "coulomb_friction": "no"},
            {"/bias": "a valid number", "/coulomb_friction": EITHER_WAY},
        ),
    ],
)  # fmt: skip
def test_a_plant_at_fault_is_told_where_and_how(
    system: dict[str, Any], expected: dict[str, str]
) -> None:
    found = faults(system=system)
    assert found.keys() == {f"/system{pointer}" for pointer in expected}
    for pointer, detail in expected.items():
        assert detail in found[f"/system{pointer}"]


@pytest.mark.parametrize("name", ["EMPS", "", "mass", "Emps "])
def test_an_unknown_machine_is_told_which_there_are(name: str) -> None:
    assert faults(system=name) == {"/system": f"no machine {name!r}; there are: {MACHINES}"}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"system": 3}, {"/system": "must be an object, or the name of a machine"}),
        ({"system": ["emps"]}, {"/system": "must be an object, or the name of a machine"}),
        ({"method": 3}, {"/method": "must be an object, or the name of a method"}),
        ({"refine": 3}, {"/refine": "must be an object, true or false"}),
        ({"initial": "cem"}, {"/initial": "must be an object"}),
        ({"pending_controls": 3}, {"/pending_controls": "must be an array"}),
    ],
)
def test_what_may_stand_there_is_told(fields: dict[str, Any], expected: dict[str, str]) -> None:
    assert faults(**fields) == expected


def test_a_key_that_is_called_like_a_kind_does_no_harm() -> None:
    friction = {"ByDirection": [1], "constrained-float": {"forward": 1}, "forward": 0.1}
    assert faults(system={"coulomb_friction": friction}) == {
        "/system/coulomb_friction/backward": "Field required",
        "/system/coulomb_friction/ByDirection": "Unexpected keyword argument",
        "/system/coulomb_friction/constrained-float": "Unexpected keyword argument",
    }


@pytest.mark.parametrize("value", ["median", 0.9, None, True, ["mean"]])
def test_what_is_neither_a_name_nor_an_object_gets_one_error(value: Any) -> None:
    detail = "must be 'mean' or 'worst', or an object with cvar"
    uncertainty = {"relative": {}, "risk": value}
    assert faults(uncertainty=uncertainty) == {"/uncertainty/risk": detail}


def test_of_a_risk_that_is_an_object_its_own_errors_are_told() -> None:
    for risk, pointer in (({"cvar": 2}, "cvar"), ({"cvar": "1"}, "cvar"), ({}, "cvar")):
        found = faults(uncertainty={"relative": {}, "risk": risk})
        assert list(found) == [f"/uncertainty/risk/{pointer}"]
