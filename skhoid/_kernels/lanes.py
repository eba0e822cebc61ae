"""Vectors of lanes: what kernels compute for several runs or settings at once.

In compiled code a vector is one of LLVM's, which become the widest instructions of the machine
whatever the loop around them; uncompiled it is a NumPy array. Operators work lane by lane, as
:func:`fma` does: nothing is reordered or fused but what is written so, and a lane gives the same
bits beside any others. Vectors are never changed in place. A mask is a vector of truth values.
"""

from __future__ import annotations

import operator
import zlib
from pathlib import Path

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model, type_callable

# Compiled kernels are stored for as long as their own file does not change. Those with vectors bear
# this number in their names, so that they are compiled anew when this file does.
VERSION = zlib.crc32(Path(__file__).read_bytes())


def load(array, at, lanes):
    """Lanes of a contiguous array from the flat position ``at`` on."""
    return array.reshape(-1)[at : at + lanes].copy()


def store(array, at, vector):
    """Write lanes into a contiguous array from the flat position ``at`` on."""
    array.reshape(-1)[at : at + len(vector)] = vector


def rows(n, lanes):
    """Room for n vectors on the stack, their values not yet set; index it as a list."""
    return [np.zeros(lanes)] * n


def find_rows(array, at, lanes):
    """Room for vectors in an array from the flat position ``at`` on, for what is too large."""
    return [np.zeros(lanes)] * ((array.size - at) // lanes)


def spread(value, lanes):
    """The same number, or one lane, in all lanes."""
    return np.full(lanes, value)


def everywhere(lanes):
    """A mask that is true."""
    return np.full(lanes, True)


def fma(a, b, c):
    """Compute a b + c, with one rounding where compiled."""
    return a * b + c


def select(mask, a, b):
    """``a`` where the mask is true, elsewhere ``b``."""
    return np.where(mask, a, b)


def minimum(a, b):
    """The smaller one; b where one of them is NaN."""
    return np.where(a < b, a, b)


def maximum(a, b):
    """The larger one; b where one of them is NaN."""
    return np.where(a > b, a, b)


def every(mask):
    """Whether a mask is true in all lanes, as compiled code expects it to be."""
    return bool(mask.all())


class Vector(types.Type):
    """Vector or mask of lanes."""

    def __init__(self, lanes: int, is_mask: bool = False) -> None:
        self.lanes, self.is_mask = lanes, is_mask
        super().__init__(f"{'mask' if is_mask else 'vector'}{lanes}")


class Rows(types.Type):
    """Pointer to vectors."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(f"rows{lanes}")


def _ir(vector):
    return ir.VectorType(ir.IntType(1) if vector.is_mask else ir.DoubleType(), vector.lanes)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, vector):
        super().__init__(manager, vector, _ir(vector))


@register_model(Rows)
class _RowsModel(models.PrimitiveModel):
    def __init__(self, manager, of):
        super().__init__(manager, of, _ir(Vector(of.lanes)).as_pointer())


def _spread(builder, value, to):
    """A number, a truth value or one lane in all lanes; a vector of that width as it is."""
    if value.type == to:
        return value
    zero = ir.Constant(ir.IntType(32), 0)
    if isinstance(value.type, ir.VectorType):
        value = builder.extract_element(value, zero)
    one = builder.insert_element(ir.Constant(to, ir.Undefined), value, zero)
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), to.count), None)
    return builder.shuffle_vector(one, ir.Constant(to, ir.Undefined), everywhere)


def _typed(function):
    """Make a function of the types of arguments the typing of ``function`` in compiled code."""

    def decorate(typing):
        type_callable(function)(lambda context: typing)
        return typing

    return decorate


def _literal(*values):
    return all(isinstance(value, types.IntegerLiteral) for value in values)


@_typed(load)
def _(array, at, lanes):
    if isinstance(array, types.Array) and array.layout == "C" and _literal(lanes):
        return Vector(lanes.literal_value)
    return None


@_typed(store)
def _(array, at, vector):
    return types.void if isinstance(array, types.Array) and array.layout == "C" else None


@_typed(rows)
def _(n, lanes):
    return Rows(lanes.literal_value) if _literal(n, lanes) else None


@_typed(find_rows)
def _(array, at, lanes):
    return Rows(lanes.literal_value) if _literal(lanes) else None


@_typed(spread)
def _(value, lanes):
    is_mask = isinstance(value, Vector) and value.is_mask
    return Vector(lanes.literal_value, is_mask) if _literal(lanes) else None


@_typed(everywhere)
def _(lanes):
    return Vector(lanes.literal_value, is_mask=True) if _literal(lanes) else None


@_typed(fma)
def _(a, b, c):
    return a


@_typed(select)
def _(mask, a, b):
    return Vector(mask.lanes)


@_typed(minimum)
@_typed(maximum)
def _(a, b):
    return a


@_typed(every)
def _(mask):
    return types.boolean


def _position(context, builder, kind, array, at, vector):
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


@lower_builtin(load, types.Array, types.Integer, types.Integer)
def _(context, builder, sig, args):
    array, at, _ = args
    where = _position(context, builder, sig.args[0], array, at, _ir(sig.return_type))
    return builder.load(where, align=8)


@lower_builtin(store, types.Array, types.Integer, Vector)
def _(context, builder, sig, args):
    array, at, vector = args
    where = _position(context, builder, sig.args[0], array, at, vector.type)
    builder.store(vector, where, align=8)
    return context.get_dummy_value()


@lower_builtin(rows, types.Integer, types.Integer)
def _(context, builder, sig, args):
    room = ir.ArrayType(_ir(Vector(sig.return_type.lanes)), sig.args[0].literal_value)
    return builder.gep(cgutils.alloca_once(builder, room), [ir.Constant(ir.IntType(32), 0)] * 2)


@lower_builtin(find_rows, types.Array, types.Integer, types.Integer)
def _(context, builder, sig, args):
    array, at, _ = args
    return _position(context, builder, sig.args[0], array, at, _ir(Vector(sig.return_type.lanes)))


@lower_builtin(spread, types.Float, types.Integer)
@lower_builtin(spread, Vector, types.Integer)
def _(context, builder, sig, args):
    return _spread(builder, args[0], _ir(sig.return_type))


@lower_builtin(everywhere, types.Integer)
def _(context, builder, sig, args):
    to = _ir(sig.return_type)
    return ir.Constant(to, [True] * to.count)


@lower_builtin(fma, Vector, Vector, Vector)
def _(context, builder, sig, args):
    kind = args[0].type
    name = f"llvm.fma.v{kind.count}f64"
    declared = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, [kind] * 3), name
    )
    return builder.call(declared, args)


@lower_builtin(select, Vector, types.Any, types.Any)
def _(context, builder, sig, args):
    to = _ir(sig.return_type)
    return builder.select(args[0], *(_spread(builder, value, to) for value in args[1:]))


def _lower_extreme(function, comparison):
    @lower_builtin(function, Vector, types.Any)
    def _(context, builder, sig, args):
        a, b = args[0], _spread(builder, args[1], args[0].type)
        return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)


_lower_extreme(minimum, "<")
_lower_extreme(maximum, ">")


@lower_builtin(every, Vector)
def _(context, builder, sig, args):
    bits = ir.IntType(sig.args[0].lanes)
    found = builder.icmp_signed("==", builder.bitcast(args[0], bits), ir.Constant(bits, -1))
    boolean = ir.IntType(1)
    kind = ir.FunctionType(boolean, [boolean] * 2)
    expect = cgutils.get_or_insert_function(builder.module, kind, "llvm.expect.i1")
    return builder.call(expect, [found, ir.Constant(boolean, True)])


def _is_number(kind):
    return isinstance(kind, types.Float) or (isinstance(kind, Vector) and not kind.is_mask)


def _lower_operator(function, build, is_mask, takes):
    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            vectors = {kind for kind in args if isinstance(kind, Vector)}
            if len(vectors) != 1 or not all(takes(kind) for kind in args):
                return None
            return signature(Vector(vectors.pop().lanes, is_mask), *args)

    def lower(context, builder, sig, args):
        to = next(value.type for value in args if isinstance(value.type, ir.VectorType))
        return build(builder, *(_spread(builder, value, to) for value in args))

    for pattern in ((Vector, Vector), (Vector, types.Float), (types.Float, Vector), (Vector,)):
        lower_builtin(function, *pattern)(lower)


for _function, _build in {
    operator.add: ir.IRBuilder.fadd,
    operator.sub: ir.IRBuilder.fsub,
    operator.mul: ir.IRBuilder.fmul,
    operator.truediv: ir.IRBuilder.fdiv,
    operator.neg: ir.IRBuilder.fneg,
}.items():
    _lower_operator(_function, _build, False, _is_number)


def _compared(sign):
    # With NaN only != is true, as everywhere.
    name = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
    return lambda builder, a, b: getattr(builder, name)(sign, a, b)


for _function, _sign in {
    operator.lt: "<",
    operator.le: "<=",
    operator.gt: ">",
    operator.ge: ">=",
    operator.eq: "==",
    operator.ne: "!=",
}.items():
    _lower_operator(_function, _compared(_sign), True, _is_number)

for _function, _build in {
    operator.and_: ir.IRBuilder.and_,
    operator.or_: ir.IRBuilder.or_,
    operator.invert: ir.IRBuilder.not_,
}.items():
    _lower_operator(_function, _build, True, lambda kind: isinstance(kind, Vector) and kind.is_mask)


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and isinstance(args[1], types.Integer):
            return signature(Vector(args[0].lanes), *args)
        return None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args, kws):
        if isinstance(args[0], Rows) and args[2] == Vector(args[0].lanes):
            return signature(types.none, *args)
        return None


@lower_builtin(operator.getitem, Rows, types.Integer)
def _(context, builder, sig, args):
    return builder.load(builder.gep(args[0], [args[1]]), align=8)


@lower_builtin(operator.setitem, Rows, types.Integer, Vector)
def _(context, builder, sig, args):
    builder.store(args[2], builder.gep(args[0], [args[1]]), align=8)
    return context.get_dummy_value()
