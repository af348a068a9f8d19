"""Eight float64 side by side: a SIMD register as a value in compiled kernels.

A kernel written on lanes advances eight rollouts at once, one per lane. It does not rely on numba
to vectorise loops: these are vectors from the start (LLVM's `<8 x double>`: one AVX-512 register,
two of AVX2, four of NEON). Every operation is IEEE and elementwise, and `fma` rounds once, so the
bits of a lane depend only on that lane.

Memory is an address and a position that counts eight-byte numbers, without bounds checks. Addresses
replace arrays because numba counts array references in every call, which costs more than the
arithmetic. An address does not keep its array alive: use `address` only on arguments.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import models, register_model

from core.kernels.compiled import jit
from core.types import Array

intrinsic: Any = numba_intrinsic  # decorated functions are called without the argument `typing`

WIDTH = 8
UNROLLED = 9  # largest matrices for which products are unrolled
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_REAL = ir.DoubleType()
_INDEX = ir.IntType(32)
_INTEGER = ir.IntType(64)
_INTEGERS = ir.VectorType(_INTEGER, WIDTH)


class _LanesType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Lanes")


class _WholeLanesType(types.Type):
    """Eight unsigned integers of 64 bits."""

    def __init__(self) -> None:
        super().__init__(name="WholeLanes")


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type) -> None:
        super().__init__(manager, numba_type, _VECTOR)


@register_model(_WholeLanesType)
class _WholeLanesModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type) -> None:
        super().__init__(manager, numba_type, _INTEGERS)


lanes, whole_lanes = _LanesType(), _WholeLanesType()


def aligned(size: int) -> Array:
    """Uninitialised workspace of `size` numbers, aligned to a cache line."""
    work = np.empty(size + WIDTH)
    skip = -(work.ctypes.data // 8) % WIDTH
    return work[skip : skip + size]


def _pointer(builder, address, position, pointee):
    base = builder.inttoptr(address, _REAL.as_pointer())
    return builder.bitcast(builder.gep(base, [position]), pointee.as_pointer())


def _call(builder, name: str, arguments):
    """Call one of LLVM's elementwise functions."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
    name = f"llvm.{name}.v{WIDTH}f64"
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _reader(numba_type, llvm_type):
    @intrinsic
    def read(typing, address, position):
        """Return what is at this position."""

        def generate(context, builder, signature, arguments):
            address, position = arguments
            return builder.load(_pointer(builder, address, position, llvm_type), align=8)

        return numba_type(types.intp, types.intp), generate

    return read


def _writer(numba_type, llvm_type):
    @intrinsic
    def write(typing, address, position, value):
        """Write to this position."""

        def generate(context, builder, signature, arguments):
            address, position, value = arguments
            builder.store(value, _pointer(builder, address, position, llvm_type), align=8)
            return context.get_dummy_value()

        return types.void(types.intp, types.intp, numba_type), generate

    return write


load, store = _reader(lanes, _VECTOR), _writer(lanes, _VECTOR)
load_whole = _reader(whole_lanes, _INTEGERS)
read, write = _reader(types.float64, _REAL), _writer(types.float64, _REAL)
read_integer, write_integer = _reader(types.int64, _INTEGER), _writer(types.int64, _INTEGER)


@intrinsic
def address(typing, array):
    """Address of an array's first number."""
    if array.layout != "C":
        raise TypingError("kernels need C-contiguous arrays: pass np.ascontiguousarray(array)")

    def generate(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, _INTEGER)

    return types.intp(array), generate


def pointer_to(numba_type):
    """Function that turns an address into a pointer to numbers of a type."""

    @intrinsic
    def pointer(typing, address):
        """Return the address as a pointer, for `carray`."""

        def generate(context, builder, signature, arguments):
            kind = context.get_value_type(signature.return_type)
            return builder.inttoptr(arguments[0], kind)

        return types.CPointer(numba_type)(types.intp), generate

    return pointer


def _spread(numba_type, numba_scalar, vector):
    @intrinsic
    def spread(typing, scalar):
        """One number in all eight lanes."""

        def generate(context, builder, signature, arguments):
            first = builder.insert_element(
                ir.Constant(vector, ir.Undefined), arguments[0], _INDEX(0)
            )
            zeros = ir.Constant(ir.VectorType(_INDEX, WIDTH), [0] * WIDTH)
            return builder.shuffle_vector(first, first, zeros)

        return numba_type(numba_scalar), generate

    return spread


splat = _spread(lanes, types.float64, _VECTOR)
splat_whole = _spread(whole_lanes, types.uint64, _INTEGERS)


def _of_two(numba_type, instruction: str):
    @intrinsic
    def operation(typing, a, b):
        """Return the result of an instruction on each lane."""
        return numba_type(numba_type, numba_type), lambda context, builder, signature, x: getattr(
            builder, instruction
        )(*x)

    return operation


add, subtract = _of_two(lanes, "fadd"), _of_two(lanes, "fsub")
multiply, divide = _of_two(lanes, "fmul"), _of_two(lanes, "fdiv")
add_whole, multiply_whole = _of_two(whole_lanes, "add"), _of_two(whole_lanes, "mul")
exclusive_or, shift_right = _of_two(whole_lanes, "xor"), _of_two(whole_lanes, "lshr")
both = _of_two(whole_lanes, "and_")


@intrinsic
def real(typing, whole):
    """Integers below 2^63 as real numbers."""
    return lanes(whole_lanes), lambda context, builder, signature, x: builder.sitofp(*x, _VECTOR)


@intrinsic
def gather_pairs(typing, address, positions):
    """The numbers at eight positions, and those after them: each pair is loaded at once."""

    def generate(context, builder, signature, arguments):
        address, positions = arguments
        table, two = builder.inttoptr(address, _REAL.as_pointer()), ir.VectorType(_REAL, 2)
        parts = []
        for lane in map(_INDEX, range(WIDTH)):
            place = builder.gep(table, [builder.extract_element(positions, lane)])
            parts.append(builder.load(builder.bitcast(place, two.as_pointer()), align=8))

        def join(a, b, which):
            return builder.shuffle_vector(
                a, b, ir.Constant(ir.VectorType(_INDEX, len(which)), which)
            )

        while len(parts) > 2:
            every = [*range(2 * parts[0].type.count)]
            parts = [join(a, b, every) for a, b in zip(parts[::2], parts[1::2], strict=True)]
        left, right = parts
        ends = [join(left, right, [*range(first, 2 * WIDTH, 2)]) for first in (0, 1)]
        return context.make_tuple(builder, signature.return_type, ends)

    return types.UniTuple(lanes, 2)(types.intp, whole_lanes), generate


@intrinsic
def fma(typing, a, b, c):
    """Return a b + c, rounded once."""
    return lanes(lanes, lanes, lanes), lambda context, builder, signature, x: _call(
        builder, "fma", x
    )


def _of_one(name: str):
    @intrinsic
    def operation(typing, a):
        """Return one of LLVM's functions of each lane."""
        return lanes(lanes), lambda context, builder, signature, x: _call(builder, name, x)

    return operation


magnitude, floor = _of_one("fabs"), _of_one("floor")


@intrinsic
def total(typing, a):
    """Sum of the eight lanes, in order."""

    def generate(context, builder, signature, arguments):
        out = builder.extract_element(arguments[0], _INDEX(0))
        for i in range(1, WIDTH):
            out = builder.fadd(out, builder.extract_element(arguments[0], _INDEX(i)))
        return out

    return types.float64(lanes), generate


def _picker(numba_type, numba_scalar):
    @intrinsic
    def pick(typing, a, lane):
        """Return one lane, 0 to 7."""

        def generate(context, builder, signature, arguments):
            return builder.extract_element(*arguments)

        return numba_scalar(numba_type, types.intp), generate

    return pick


pick, pick_whole = _picker(lanes, types.float64), _picker(whole_lanes, types.uint64)


@intrinsic
def where_greater(typing, a, b, x, y):
    """x in lanes with a > b, else y (also if a or b is NaN)."""

    def generate(context, builder, signature, arguments):
        a, b, x, y = arguments
        return builder.select(builder.fcmp_ordered(">", a, b), x, y)

    return lanes(lanes, lanes, lanes, lanes), generate


@intrinsic
def at_most(typing, a, b):
    """One bit per lane, lowest for the first lane: whether a <= b; not for NaN."""

    def generate(context, builder, signature, arguments):
        holds = builder.fcmp_ordered("<=", *arguments)
        return builder.zext(builder.bitcast(holds, ir.IntType(WIDTH)), _INTEGER)

    return types.uint64(lanes, lanes), generate


@intrinsic
def lowest_bit(typing, bits):
    """Number of the lowest set bit; at least one must be set."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


@intrinsic
def prefetch(typing, address, position):
    """Prefetch the cache line at this position."""

    def generate(context, builder, signature, arguments):
        address, position = arguments
        place = _pointer(builder, address, position, ir.IntType(8))
        kind = ir.FunctionType(ir.VoidType(), [place.type] + [_INDEX] * 3)
        function = builder.module.declare_intrinsic("llvm.prefetch", (place.type,), kind)
        builder.call(function, [place, _INDEX(0), _INDEX(3), _INDEX(1)])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp), generate


def _column_function(module, n: int, columns: int):
    """Define, once per module, out = start + left right for `columns` columns, n unrolled rows."""
    vectors = _VECTOR.as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [vectors] * 4 + [_INTEGER])
    function = cgutils.get_or_insert_function(module, kind, f"lanes_columns_{n}_{columns}")
    if function.blocks:
        return function
    function.linkage = "internal"
    function.attributes.add(
        "noinline"
    )  # one copy, because inlining it everywhere takes seconds to compile
    left, right, start, out, stride = function.args
    builder = ir.IRBuilder(function.append_basic_block())

    def item(base, row, column):
        skip = builder.mul(stride, _INTEGER(row))
        return builder.gep(base, [builder.add(skip, _INTEGER(column))])

    places = [(i, j) for i in range(n) for j in range(columns)]
    sums: dict[tuple[int, int], ir.Value] = {
        place: builder.load(item(start, *place), align=8) for place in places
    }
    for k in range(n):
        x = [builder.load(item(right, k, j), align=8) for j in range(columns)]
        for i in range(n):
            a = builder.load(builder.gep(left, [_INTEGER(i * n + k)]), align=8)
            for j in range(columns):
                sums[i, j] = _call(builder, "fma", [a, x[j], sums[i, j]])
    for place in places:
        builder.store(sums[place], item(out, *place), align=8)
    builder.ret_void()
    return function


def _switch(builder, n, case) -> None:
    """Branch to `case(size)` for the size n, 1 to UNROLLED; nothing for others."""
    end = builder.append_basic_block("sizes_end")
    switch = builder.switch(n, end)
    for size in range(1, UNROLLED + 1):
        block = builder.append_basic_block(f"size_{size}")
        switch.add_case(ir.Constant(n.type, size), block)
        with builder.goto_block(block):
            case(size)
            builder.branch(end)
    builder.position_at_end(end)


def _columns(columns: int):
    @intrinsic
    def multiply_columns(typing, w, left, right, start, out, n, stride):
        """out = start + left right for some columns, 1 <= n <= UNROLLED rows, kept in registers.

        left[i, k] is at left + 8 (n i + k) of w; right[k, j], start[i, j] and out[i, j] have rows
        `stride` vectors apart. Does nothing for other n.
        """

        def generate(context, builder, signature, arguments):
            w, *places, n, stride = arguments
            pointers = [_pointer(builder, w, place, _VECTOR) for place in places]

            def call(size):
                function = _column_function(builder.module, size, columns)
                builder.call(function, [*pointers, stride])

            _switch(builder, n, call)
            return context.get_dummy_value()

        return types.void(*[types.intp] * 7), generate

    return multiply_columns


multiply_column, multiply_column_pair = _columns(1), _columns(2)


def _advance_function(module, n: int):
    """Define, once per module, out = left (inputs; state), n sums in registers."""
    vectors = _VECTOR.as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [vectors] * 4 + [_INTEGER])
    function = cgutils.get_or_insert_function(module, kind, f"lanes_advance_{n}")
    if function.blocks:
        return function
    function.linkage = "internal"
    function.attributes.add("noinline")
    left, inputs, state, out, n_inputs = function.args
    builder = ir.IRBuilder(function.append_basic_block())
    sums = [
        cgutils.alloca_once_value(builder, ir.Constant(_VECTOR, [0.0] * WIDTH)) for _ in range(n)
    ]

    def add_columns(left, right, count):
        with cgutils.for_range(builder, count) as loop:
            x = builder.load(builder.gep(right, [loop.index]), align=8)
            column = builder.gep(left, [builder.mul(loop.index, _INTEGER(n))])
            for i in range(n):
                a = builder.load(builder.gep(column, [_INTEGER(i)]), align=8)
                builder.store(_call(builder, "fma", [a, x, builder.load(sums[i])]), sums[i])

    add_columns(left, inputs, n_inputs)
    add_columns(builder.gep(left, [builder.mul(n_inputs, _INTEGER(n))]), state, _INTEGER(n))
    for i in range(n):
        builder.store(builder.load(sums[i]), builder.gep(out, [_INTEGER(i)]), align=8)
    builder.ret_void()
    return function


@intrinsic
def advance(typing, w, left, inputs, n_inputs, state, out, n):
    """out = left (inputs; state), 1 <= n <= UNROLLED states, kept in registers.

    left (n, n_inputs + n) by columns: entry (i, k) is at left + 8 (n k + i) of w.
    Does nothing for other n.
    """

    def generate(context, builder, signature, arguments):
        w, left, inputs, n_inputs, state, out, n = arguments
        pointers = [_pointer(builder, w, place, _VECTOR) for place in (left, inputs, state, out)]

        def call(size):
            builder.call(_advance_function(builder.module, size), [*pointers, n_inputs])

        _switch(builder, n, call)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 7), generate


@intrinsic
def store_transposed(typing, source, rows, target, places, offset):
    """Transpose an 8 x 8 block: lane l of eight source vectors becomes eight numbers in `target`.

    target[places[l] + offset + i] = source[rows[i] + l]; rows, places: addresses of eight integers.
    """

    def generate(context, builder, signature, arguments):
        source, rows, target, places, offset = arguments

        def row(i):
            return _pointer(builder, source, _integer(builder, rows, i), _VECTOR)

        def place(lane):
            at = builder.add(_integer(builder, places, lane), offset)
            return _pointer(builder, target, at, _VECTOR)

        _transpose(builder, row, place)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), generate


def _between_rows_and_lanes(to_lanes: bool):
    @intrinsic
    def exchange(typing, rows, numbers, length, offset, vectors):
        """Transpose an 8 x 8 block between eight rows and eight vectors.

        rows[numbers[l] length + offset + i] and vectors[8 i + l]; numbers: address of eight
        integers.
        """

        def generate(context, builder, signature, arguments):
            rows, numbers, length, offset, vectors = arguments

            def row(lane):
                start = builder.mul(_integer(builder, numbers, lane), length)
                return _pointer(builder, rows, builder.add(start, offset), _VECTOR)

            def vector(i):
                return _pointer(builder, vectors, _INTEGER(WIDTH * i), _VECTOR)

            _transpose(builder, *((row, vector) if to_lanes else (vector, row)))
            return context.get_dummy_value()

        return types.void(*[types.intp] * 5), generate

    return exchange


_load_block, _store_block = _between_rows_and_lanes(True), _between_rows_and_lanes(False)


@jit
def load_rows(rows, numbers, length, first, count, vectors):
    """Copy `count` numbers from `first` on of eight rows, each `length` long, side by side.

    numbers: address of the rows' eight numbers.
    """
    for k in range(0, count - WIDTH + 1, WIDTH):
        _load_block(rows, numbers, length, first + k, vectors + 8 * WIDTH * k)
    for lane in range(WIDTH):
        at = read_integer(numbers, lane) * length + first
        for k in range(count - count % WIDTH, count):
            write(vectors, k * WIDTH + lane, read(rows, at + k))


@jit
def store_rows(rows, numbers, length, count, vectors):
    """Copy `count` vectors to the beginnings of eight rows, see `load_rows`."""
    for k in range(0, count - WIDTH + 1, WIDTH):
        _store_block(rows, numbers, length, k, vectors + 8 * WIDTH * k)
    for lane in range(WIDTH):
        at = read_integer(numbers, lane) * length
        for k in range(count - count % WIDTH, count):
            write(rows, at + k, read(vectors, k * WIDTH + lane))


def _integer(builder, base, i):
    return builder.load(_pointer(builder, base, _INTEGER(i), _INTEGER))


def _transpose(builder, source, target):
    """Write lane l of the eight source vectors to target l; both give a pointer by number."""
    columns = [builder.load(source(i), align=8) for i in range(WIDTH)]
    for half in (4, 2, 1):
        columns = _exchange(builder, columns, half)
    for lane, column in enumerate(columns):
        builder.store(column, target(lane), align=8)


def _exchange(builder, rows, half):
    """Swap off-diagonal blocks of `half` numbers in pairs of rows: one of three transpose steps."""
    low = [i + (WIDTH - half if i & half else 0) for i in range(WIDTH)]
    high = [i + (WIDTH if i & half else half) for i in range(WIDTH)]
    masks = [ir.Constant(ir.VectorType(_INDEX, WIDTH), mask) for mask in (low, high)]
    exchanged = list(rows)
    for i in range(WIDTH):
        if not i & half:
            pair = rows[i], rows[i + half]
            exchanged[i] = builder.shuffle_vector(*pair, masks[0])
            exchanged[i + half] = builder.shuffle_vector(*pair, masks[1])
    return exchanged
