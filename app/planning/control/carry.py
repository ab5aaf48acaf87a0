"""A controller's memory as a client carries it from step to step: plain, bounded, checked."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.control.memory import (
    MAX_PLAN,
    NUM_ESTIMATED,
    NUM_REGISTERS,
    PLAN_AGE,
    PLAN_LENGTH,
    Memory,
)
from app.planning.plant.system import LARGEST

VERSION = 2
LOWER = np.tril_indices(NUM_ESTIMATED)
ROUNDING = 1e-9
"""Relative: a covariance may be this far from having no negative variance."""
FIELDS = ("version", "plan", "plan_age", "mean", "covariance", "statics", "registers")
NUM_OTHERS = NUM_REGISTERS - 2
"""Registers beside those of the plan."""


class InvalidCarry(ValueError):
    """What was carried is not what a step gave."""

    def __init__(self, field: str, message: str) -> None:
        super().__init__(f"carry: {field} {message}" if field else f"carry {message}")
        self.field = field


def write_carry(memory: Memory) -> dict[str, Any]:
    """Return a memory as JSON has it, at most some 25 kB; `read_carry` reads it back."""
    age, length = int(memory.registers[PLAN_AGE]), int(memory.registers[PLAN_LENGTH])
    return {
        "version": VERSION,
        "plan": memory.plan[age:length].tolist(),
        "plan_age": age,
        "mean": memory.mean.tolist(),
        "covariance": memory.covariance[LOWER].tolist(),
        "statics": memory.statics.ravel().tolist(),
        "registers": np.delete(memory.registers, [PLAN_LENGTH, PLAN_AGE]).tolist(),
    }


def read_carry(value: object) -> Memory:
    """Return the memory that `write_carry` wrote.

    Raises:
        InvalidCarry: it is not that; the error names the field.
    """
    if not isinstance(value, Mapping):
        raise InvalidCarry("", "is not an object")
    for name in FIELDS:
        if name not in value:
            raise InvalidCarry(name, "is missing")
    for name in value:
        if name not in FIELDS:
            raise InvalidCarry(str(name)[:64], "is not known")
    if value["version"] != VERSION:
        raise InvalidCarry("version", f"is not {VERSION}: begin anew without a carry")
    age = value["plan_age"]
    if not isinstance(age, int) or isinstance(age, bool) or not 0 <= age <= MAX_PLAN:
        raise InvalidCarry("plan_age", f"is not a whole number from 0 to {MAX_PLAN}")
    memory = Memory.empty()
    plan = _numbers(value, "plan", (0, MAX_PLAN - age))
    memory.plan[age : age + plan.size] = plan
    memory.mean[:] = _numbers(value, "mean", (NUM_ESTIMATED,) * 2)
    memory.covariance[LOWER] = _numbers(value, "covariance", (len(LOWER[0]),) * 2, LARGEST**2)
    memory.covariance.T[LOWER] = memory.covariance[LOWER]
    least = np.linalg.eigvalsh(memory.covariance)[0]
    if least < -ROUNDING * max(1.0, float(np.abs(memory.covariance).max())):
        raise InvalidCarry("covariance", "has a negative variance")
    statics = _numbers(value, "statics", (memory.statics.size,) * 2)
    if np.any(statics < 0.0):
        raise InvalidCarry("statics", "must not be negative")
    memory.statics[:] = statics.reshape(memory.statics.shape)
    others = _numbers(value, "registers", (NUM_OTHERS,) * 2)
    memory.registers[np.delete(np.arange(NUM_REGISTERS), [PLAN_LENGTH, PLAN_AGE])] = others
    memory.registers[PLAN_AGE], memory.registers[PLAN_LENGTH] = age, age + plan.size
    return memory


def _numbers(
    value: Mapping[Any, Any], name: str, lengths: tuple[int, int], largest: float = LARGEST
) -> FloatArray:
    """Return a field as an array (N,) of numbers within `largest`, N between two `lengths`."""
    numbers = value[name]
    fewest, most = lengths
    if not isinstance(numbers, list | tuple) or not fewest <= len(numbers) <= most:
        count = f"{fewest}" if fewest == most else f"{fewest} to {most}"
        raise InvalidCarry(name, f"is not a list of {count} numbers")
    for number in numbers:
        is_number = isinstance(number, int | float) and not isinstance(number, bool)
        if not is_number or not math.isfinite(number) or abs(number) > largest:
            raise InvalidCarry(name, f"holds what is not a number within {largest:g}")
    return np.array(numbers, dtype=np.float64)
