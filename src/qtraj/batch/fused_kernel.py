"""Evaluate the outputs of paths in one kernel for GPUs, written in Pallas.

Each program of the kernel reads instants of one path in blocks, and computes all outputs of a block in registers. It
writes each component once, or only the reduction of its blocks. The formulas are those of the registry; see
`instant_formulas`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from qtraj.batch.instant_formulas import Formulas, OfPath
from qtraj.batch.reduction import attained, joiner

THREADS = 128
"""Number of threads of a program. A block that is written has sixteen bytes of each component for each thread."""

BLOCKS = 64
"""Largest number of blocks of `THREADS` instants that one program reduces."""

LARGEST = 2**31 - THREADS * BLOCKS
"""Numbers of instants, counted over all paths, are below this limit.

Programs have 32-bit numbers, and the instants of the last program of a path are counted beyond the end of the path.
"""

Times = Float[Array, "rows n"]


def supports(formulas: Formulas, paths: Any, times: Times) -> bool:
    """Return whether the kernel can evaluate the formulas of the paths at the times."""
    return formulas.elementwise and _count(paths) * times.shape[1] < LARGEST


def written(formulas: Formulas, paths: Any, times: Times, interpret: bool) -> dict[str, Array]:
    """Return arrays (components, paths, instants) by the names of the outputs; `paths` are arrays (paths, …)."""
    size = _power_of_two(THREADS * 16 // times.dtype.itemsize, times.shape[1])
    components = formulas.structure.unflatten(range(len(formulas.results)))
    # Triton has no memory of booleans, so they are written as integers of eight bits.
    kinds = {name: _stored(formulas.kinds[numbers[0]]) for name, numbers in components.items()}
    shapes = [
        jax.ShapeDtypeStruct((len(numbers), _count(paths), times.shape[1]), kinds[name])
        for name, numbers in components.items()
    ]

    def body(block: _Block, outputs: Sequence[Any]) -> None:
        i, inside = block.instants(0)
        values = formulas.at(block.times(i, inside), block.constant)
        for numbers, output in zip(components.values(), outputs, strict=True):
            for k, number in enumerate(numbers):
                block.store(output.at[k, block.path, i], values[number].astype(output.dtype), inside)

    arrays = _launched(body, formulas, paths, (times,), shapes, size, 1, interpret)
    return {name: x.astype(formulas.kinds[components[name][0]]) for name, x in zip(components, arrays, strict=True)}


def peaks(formulas: Formulas, paths: Any, times: Times, reduction: str, interpret: bool) -> list[Any]:
    """Return (peak, time), each (paths,), for each component that depends on the instant.

    `reduction` is "max" or "min".
    """
    sign = 1 if reduction == "max" else -1
    size, blocks = _reduced_blocks(times)
    varying = [k for k, varies in enumerate(formulas.varying) if varies]

    def body(block: _Block, outputs: Sequence[Any]) -> None:
        def step(b: Any, running: Any) -> Any:
            i, inside = block.instants(b)
            t = block.times(i, inside)
            values = formulas.at(t, block.constant)
            pairs = [(jnp.where(inside, sign * values[k].astype(t.dtype), -jnp.inf), t) for k in varying]
            return [_later(a, x, t, inside) for a, (x, t) in zip(running, pairs, strict=True)]

        empty = jnp.full((size,), -jnp.inf, times.dtype), jnp.full((size,), jnp.inf, times.dtype)
        found = lax.fori_loop(0, blocks, step, [empty for _ in varying])
        for k, (value, when) in enumerate(found):
            undefined = jnp.max(jnp.where(value != value, 1, 0)) > 0  # the maximum of Triton ignores NaN
            peak = jnp.where(undefined, jnp.nan, jnp.max(jnp.where(value != value, -jnp.inf, value)))
            outputs[0][k, block.path, block.part] = sign * peak
            outputs[1][k, block.path, block.part] = jnp.min(jnp.where(attained(value, peak), when, jnp.inf))

    shape = jax.ShapeDtypeStruct((len(varying), _count(paths), _parts(times, size, blocks)), times.dtype)
    if not varying:
        return []
    arrays = _launched(body, formulas, paths, (times,), [shape] * 2, size, blocks, interpret)
    value, when = joiner(reduction)(tuple(jnp.moveaxis(x, 2, 0) for x in arrays))
    return list(zip(value, when, strict=True))


def sums(formulas: Formulas, paths: Any, times: Times, around: Float[Array, "rows 2"], interpret: bool) -> Any:
    """Return the integral (paths,) of each component by name; `around` are the `neighbours` of the times."""
    size, blocks = _reduced_blocks(times)
    last, count = times.shape[1] - 1, len(formulas.results)

    def body(block: _Block, outputs: Sequence[Any]) -> None:
        first_neighbour, last_neighbour = (block.inputs[1][block.row, k] for k in range(2))

        def step(b: Any, running: Any) -> Any:
            i, inside = block.instants(b)
            before = jnp.where(i > 0, block.times(jnp.maximum(i - 1, 0), inside), first_neighbour)
            after = jnp.where(i < last, block.times(jnp.minimum(i + 1, last), inside), last_neighbour)
            values = formulas.at(block.times(i, inside), block.constant)
            weights = 0.5 * (after - before)
            return [
                a + jnp.where(inside, x.astype(a.dtype) * weights, 0.0) for a, x in zip(running, values, strict=True)
            ]

        found = lax.fori_loop(0, blocks, step, [jnp.zeros((size,), times.dtype)] * count)
        for k, value in enumerate(found):
            outputs[0][k, block.path, block.part] = jnp.sum(value)

    shape = jax.ShapeDtypeStruct((count, _count(paths), _parts(times, size, blocks)), times.dtype)
    (parts,) = _launched(body, formulas, paths, (times, around), [shape], size, blocks, interpret)
    return formulas.structure.unflatten([(x,) for x in jnp.sum(parts, axis=2)])


class _Block:
    """The instants of one program: the instants of one `part` of a path, in blocks."""

    def __init__(self, path: Any, part: Any, tables: dict[str, Any], inputs: Sequence[Any], size: int, blocks: int):
        self.path, self.part, self.inputs, self._size, self._blocks = path, part, inputs, size, blocks
        self.row = path if inputs[0].shape[0] > 1 else 0
        self._tables, self._known = tables, {}
        for kind, table in tables.items():
            for k in range(table.shape[1]):  # read before the loop over the blocks
                value = table[path, k]
                self._known[OfPath(kind, k)] = value != 0 if kind == "bool" else value

    def constant(self, x: OfPath) -> Array:
        """Return a value that depends only on the path."""
        return self._known[x]

    def instants(self, block: Any) -> tuple[Array, Array]:
        """Return the numbers of the instants of a block, and whether they exist."""
        i = (self.part * self._blocks + block) * self._size + jnp.arange(self._size, dtype=jnp.int32)
        return i, i < self.inputs[0].shape[1]

    def times(self, i: Array, inside: Array) -> Array:
        """Return the times of instants."""
        from jax.experimental.pallas import triton

        return triton.load(self.inputs[0].at[self.row, i], mask=inside, other=0.0)

    @staticmethod
    def store(place: Any, values: Array, inside: Array) -> None:
        """Store the values of the instants that exist."""
        from jax.experimental.pallas import triton

        triton.store(place, values, mask=inside)


def _launched(
    body: Callable[[_Block, Sequence[Any]], None],
    formulas: Formulas,
    paths: Any,
    inputs: Sequence[Array],
    shapes: Sequence[Any],
    size: int,
    blocks: int,
    interpret: bool,
) -> list[Array]:
    """Return the arrays of the given shapes that `body` writes; it is run once for every path and part of its times."""
    from jax.experimental import pallas
    from jax.experimental.pallas import triton

    tables = formulas.constants(paths)
    parts = _parts(inputs[0], size, blocks)

    def kernel(*refs: Any) -> None:
        program, number = pallas.program_id(0), jnp.int32(parts)
        first, last = len(tables), len(tables) + len(inputs)
        named = dict(zip(tables, refs[:first], strict=True))
        path, part = lax.div(program, number), lax.rem(program, number)
        body(_Block(path, part, named, refs[first:last], size, blocks), refs[last:])

    call = pallas.pallas_call(
        kernel,
        out_shape=list(shapes),
        grid=(_count(paths) * parts,),
        interpret=interpret,
        compiler_params=triton.CompilerParams(num_warps=max(1, min(THREADS, size) // 32)),
        name="qtraj_evaluate",
    )
    return call(*[x.astype(_stored(x.dtype)) for x in tables.values()], *inputs)


def _later(running: tuple[Array, Array], x: Array, t: Array, inside: Array) -> tuple[Array, Array]:
    """Return the peaks and their first times after the samples `x` at the later times `t`; a NaN remains."""
    value, when = running
    peak = jnp.where((x > value) | (x != x), x, value)
    before = jnp.where(attained(value, peak), when, jnp.inf)
    return peak, jnp.minimum(before, jnp.where(inside & attained(x, peak), t, jnp.inf))


def _count(paths: Any) -> int:
    return jax.tree.leaves(paths)[0].shape[0]


def _stored(kind: Any) -> Any:
    return jnp.int8 if kind == jnp.bool_ else kind


def _power_of_two(largest: int, number: int) -> int:
    """Return the smallest power of two that is not less than `number`, but at most `largest` and at least 32."""
    return max(32, min(largest, 1 << (number - 1).bit_length()))


def _reduced_blocks(times: Times) -> tuple[int, int]:
    """Return the size of a block, and the number of blocks that one program reduces."""
    size = _power_of_two(THREADS, times.shape[1])
    return size, min(BLOCKS, -(-times.shape[1] // size))


def _parts(times: Times, size: int, blocks: int) -> int:
    """Return the number of programs for each path."""
    return -(-times.shape[1] // (size * blocks))
