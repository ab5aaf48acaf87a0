import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.control import PID, RecedingHorizon
from app.planning.control.carry import FIELDS, InvalidCarry, read_carry, write_carry
from app.planning.control.memory import MAX_PLAN, Memory
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import System


def carried(**changes: Any) -> dict[str, Any]:
    taken = control_step(RecedingHorizon(), System(), Measurement(0.0, 0.1), Goal(0.3, 64))
    return write_carry(taken.memory) | changes


def test_what_was_written_is_read_to_the_last_bit() -> None:
    memory = control_step(PID(), System(), Measurement(0.0, 0.1), Goal(0.3)).memory
    memory.covariance[:] = np.cov(np.random.default_rng(0).normal(size=(6, 20)))
    read = read_carry(json.loads(json.dumps(write_carry(memory))))

    for part, other in zip(read, memory, strict=True):
        np.testing.assert_array_equal(part, other)


def test_what_is_carried_stays_small() -> None:
    memory = Memory.empty()
    memory.plan[:] = -1 / 3 * np.pi
    memory.registers[1] = MAX_PLAN

    assert len(json.dumps(write_carry(memory))) < 25_000


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("version", 1),
        ("version", None),
        ("plan", "no list"),
        ("plan", [0.0] * (MAX_PLAN + 1)),
        ("plan", [float("nan")]),
        ("plan", [True]),
        ("plan_age", -1),
        ("plan_age", 1.5),
        ("plan_age", MAX_PLAN + 1),
        ("mean", [0.0] * 5),
        ("mean", [0.0] * 5 + [float("inf")]),
        ("mean", {"0": 1.0}),
        ("covariance", [-1.0] + [0.0] * 20),
        ("covariance", [1.0, 5.0] + [0.0] * 19),
        ("statics", [-0.1, 0.7, 0.7, 0.7]),
        ("registers", [0.0, 0.0, "0", 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("registers", [1e300] * 8),
    ],
)
def test_what_no_step_gave_is_refused_by_the_name_of_the_field(field: str, value: object) -> None:
    with pytest.raises(InvalidCarry, match=field) as refused:
        read_carry(carried() | {field: value})
    assert refused.value.field == field


@pytest.mark.parametrize("field", FIELDS)
def test_every_field_is_needed(field: str) -> None:
    whole = carried()
    del whole[field]

    with pytest.raises(InvalidCarry, match=f"{field} is missing"):
        read_carry(whole)


def test_no_other_field_is_known() -> None:
    with pytest.raises(InvalidCarry, match="more is not known"):
        read_carry(carried(more=1))


@pytest.mark.parametrize("value", [None, [], "carry", 1])
def test_only_an_object_is_a_carry(value: object) -> None:
    with pytest.raises(InvalidCarry, match="not an object"):
        read_carry(value)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=20,
)


@settings(max_examples=50)
@given(
    changes=st.dictionaries(
        st.sampled_from(FIELDS),
        json_values
        | st.integers(0, MAX_PLAN)
        | st.lists(st.floats(-1e6, 1e6), max_size=30)
        | st.sampled_from([4, 5, 6, 21]).flatmap(
            lambda size: st.lists(st.floats(-1e6, 1e6), min_size=size, max_size=size)
        ),
        min_size=1,
    )
)
def test_whatever_is_read_a_step_can_go_on_with(changes: dict[str, Any]) -> None:
    try:
        memory = read_carry(carried() | changes)
    except InvalidCarry:
        return
    for controller in (RecedingHorizon(), RecedingHorizon(replan_every=16), PID()):
        taken = control_step(controller, System(), Measurement(0.0, 0.1), Goal(0.3, 64), memory)
        assert -0.9 <= taken.control <= 0.9
        assert np.all(np.isfinite(taken.predicted_states))
        write_carry(taken.memory)
