"""Sixteen float32 lanes as a value in Numba kernels, and what can be done with them.

Numba leaves it to LLVM to vectorise loops, which it declines as soon as an index might be negative
or two arrays might overlap. A kernel written in `Lanes` is vector code whatever LLVM thinks; where
a processor's registers are shorter than sixteen lanes, LLVM splits them.
"""

# Numba's and LLVM's interfaces are hardly typed.
# mypy: disable-error-code="no-untyped-call,untyped-decorator"

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, register_model

from app.compilation import compiled

LANES = 16
Vector = Any
"""A value of type `Lanes` inside a kernel; it does not exist outside."""

_FLOATS = ir.VectorType(ir.FloatType(), LANES)
_INTEGERS = ir.VectorType(ir.IntType(32), LANES)
_EXPONENT_BIAS, _MANTISSA_BITS = 127, 23


Intrinsic = Callable[..., Any]


def _intrinsic(function: Callable[..., Any]) -> Intrinsic:
    """Numba's decorator, typed: `function` returns a signature and what generates its code."""
    typed: Intrinsic = intrinsic(function)
    return typed


class Lanes(types.Type):
    """The Numba type."""

    def __init__(self) -> None:
        super().__init__(name="float32x16")


LANES_TYPE = Lanes()


@register_model(Lanes)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Lanes) -> None:
        super().__init__(manager, numba_type, _FLOATS)


def _define_operator(function: Callable[..., Any], instruction: str) -> None:
    @infer_global(function)
    class _Template(ConcreteTemplate):
        cases = [signature(LANES_TYPE, LANES_TYPE, LANES_TYPE)]

    @lower_builtin(function, LANES_TYPE, LANES_TYPE)
    def _lower(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(*arguments)


for _function, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define_operator(_function, _instruction)


def _llvm_function(name: str, arity: int) -> Intrinsic:
    """Return LLVM's own vector function of that name as an intrinsic of Numba."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        function = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(_FLOATS, [_FLOATS] * arity),
            f"llvm.{name}.v{LANES}f32",
        )
        return builder.call(function, arguments)

    # Numba reads the number of arguments from the signature.
    typings: dict[int, Callable[..., Any]] = {
        1: lambda _, x: (LANES_TYPE(x), generate),
        2: lambda _, x, y: (LANES_TYPE(x, y), generate),
        3: lambda _, x, y, z: (LANES_TYPE(x, y, z), generate),
    }
    return _intrinsic(typings[arity])


floor = _llvm_function("floor", 1)
minimum = _llvm_function("minnum", 2)
maximum = _llvm_function("maxnum", 2)
multiply_add = _llvm_function("fma", 3)
"""x * y + z, rounded once."""


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [index])


def _spread(builder: Any, scalar: Any) -> Any:
    undefined = ir.Constant(_FLOATS, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.IntType(32)(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(_INTEGERS, [0] * LANES))


@_intrinsic
def load(_typing: Any, array: Any, index: Any) -> Any:
    """Return array[index : index + 16] of a contiguous float32 array; nothing checks the bounds."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], *arguments)
        return builder.load(builder.bitcast(pointer, _FLOATS.as_pointer()), align=4)

    return LANES_TYPE(array, types.intp), generate


@_intrinsic
def store(_typing: Any, array: Any, index: Any, vector: Any) -> Any:
    """Write array[index : index + 16]; nothing checks the bounds."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], builder.bitcast(pointer, _FLOATS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, LANES_TYPE), generate


@_intrinsic
def spread(_typing: Any, scalar: Any) -> Any:
    """Return sixteen times a float32."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0])

    return LANES_TYPE(types.float32), generate


@_intrinsic
def spread_from(_typing: Any, array: Any, index: Any) -> Any:
    """Return sixteen times array[index]; nothing checks the bounds."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(
            builder, builder.load(_pointer(context, builder, signature.args[0], *arguments))
        )

    return LANES_TYPE(array, types.intp), generate


@_intrinsic
def power_of_two(_typing: Any, exponent: Any) -> Any:
    """Return 2^n for lanes that hold whole numbers n from -126 to 127."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        biased = builder.add(
            builder.fptosi(arguments[0], _INTEGERS),
            ir.Constant(_INTEGERS, [_EXPONENT_BIAS] * LANES),
        )
        bits = builder.shl(biased, ir.Constant(_INTEGERS, [_MANTISSA_BITS] * LANES))
        return builder.bitcast(bits, _FLOATS)

    return LANES_TYPE(LANES_TYPE), generate


_ONE = np.float32(1)
_HALF = np.float32(0.5)
_MINUS_LOG2_E = np.float32(-np.log2(np.e))
_LARGEST_EXPONENT = np.float32(126)
# 2^f for f in [-1/2, 1/2], Cephes' exp2f.
_P6, _P5, _P4, _P3, _P2, _P1 = (
    np.float32(p)
    for p in (
        1.535336188319500e-4,
        1.339887440266574e-3,
        9.618437357674640e-3,
        5.550332471162809e-2,
        2.402264791363012e-1,
        6.931472028550421e-1,
    )
)


@compiled
def silu(x: Vector) -> Vector:
    """Return x / (1 + exp(-x)), to 1e-6 of its size above -16 and 5e-6 below.

    Below -87, where the exponential is no float32, it is at most x / 2^126 instead.
    """
    limit = spread(_LARGEST_EXPONENT)
    y = minimum(maximum(x * spread(_MINUS_LOG2_E), spread(-_LARGEST_EXPONENT)), limit)
    whole = floor(y + spread(_HALF))
    part = y - whole
    power = multiply_add(spread(_P6), part, spread(_P5))
    power = multiply_add(power, part, spread(_P4))
    power = multiply_add(power, part, spread(_P3))
    power = multiply_add(power, part, spread(_P2))
    power = multiply_add(power, part, spread(_P1))
    power = multiply_add(power, part, spread(_ONE))
    return x / multiply_add(power, power_of_two(whole), spread(_ONE))
