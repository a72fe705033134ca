"""Divide the formulas of an evaluation into those of the path and those of the instant, for a kernel or a reduction.

The formulas are traced once, for one path and one instant. Operations that do not depend on the instant are computed
once for each path, before the kernel. If all other operations are elementwise, a kernel can apply them to a block of
instants. Searches and gathers, as in a route, and stacked components, as in a `Curve`, are not elementwise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Literal
from jaxtyping import Array

ELEMENTWISE = frozenset((
    "abs", "acos", "acosh", "add", "and", "asin", "asinh", "atan", "atan2", "atanh", "bitcast_convert_type", "cbrt",
    "ceil", "clamp", "convert_element_type", "cos", "cosh", "div", "eq", "exp", "exp2", "expm1", "floor", "ge", "gt",
    "integer_pow", "is_finite", "le", "log", "log1p", "logistic", "lt", "max", "min", "mul", "ne", "neg", "not", "or",
    "pow", "rem", "round", "rsqrt", "select_n", "shift_left", "shift_right_arithmetic", "shift_right_logical", "sign",
    "sin", "sinh", "sqrt", "square", "sub", "tan", "tanh", "xor",
))  # fmt: skip
"""Operations on each element that Pallas lowers for GPUs; `round` is replaced by other operations."""

UNCHANGED = frozenset((
    "broadcast_in_dim", "copy", "expand_dims", "in_one_loop", "optimization_barrier", "reshape", "squeeze",
    "stop_gradient", "transpose",
))  # fmt: skip
"""Operations that do not change the value of an array with one element."""


class Step:
    """A value that depends on the instant: the result of one operation on the `operands`, or the instant itself."""

    def __init__(self, primitive: Any = None, params: Any = None, operands: Sequence[Any] = ()):
        self.primitive, self.params, self.operands = primitive, params, operands


@dataclass(frozen=True)
class OfPath:
    """The number of a value that depends only on the path, among the values of the same dtype."""

    dtype: str
    number: int


@dataclass(frozen=True)
class Formulas:
    """The outputs of one instant.

    `constants` returns arrays (paths, n) by dtype: the n values that depend only on the path. `results` are the leaves
    of the result of the work, whose `structure` is known: each is a `Step` (it depends on the instant), an `OfPath` or
    a number. `kinds` are their dtypes. `elementwise` is False if `at` cannot compute them.
    """

    constants: Callable[[Any], dict[str, Array]]
    results: list[Any]
    kinds: list[Any]
    structure: Any
    elementwise: bool

    @property
    def varying(self) -> list[bool]:
        """Whether each output depends on the instant."""
        return [isinstance(x, Step) for x in self.results]

    def varying_of(self, values: Any) -> list[Any]:
        """Return the leaves of the result of the work that depend on the instant."""
        leaves = zip(self.structure.flatten_up_to(values), self.varying, strict=True)
        return [x for x, varies in leaves if varies]

    def merged(self, varying: Sequence[Any], constant: Sequence[Any]) -> Any:
        """Return results in the structure of the work; `constant` are those that do not depend on the instant."""
        parts = {True: iter(varying), False: iter(constant)}
        return self.structure.unflatten([next(parts[varies]) for varies in self.varying])

    def at(self, t: Array, constant: Callable[[OfPath], Array]) -> list[Array]:
        """Return the outputs at the instants `t` (n,), each (n,); `constant` returns a value that depends on the path.

        The function uses elementwise operations only.
        """
        done: dict[int, Array] = {}

        def value(x: Any) -> Any:
            if isinstance(x, Step):
                return t if x.primitive is None else done[id(x)]
            return constant(x) if isinstance(x, OfPath) else x

        for step in _in_order(self.results):
            done[id(step)] = _applied(step, [value(x) for x in step.operands], t.shape)
        outputs = zip(self.results, self.kinds, strict=True)
        return [jnp.broadcast_to(jnp.asarray(value(x), kind), t.shape) for x, kind in outputs]


def instant_formulas(work: Callable[[Any, Any], Any], paths: Any, times: Any) -> Formulas:
    """Return the formulas of `work`, a function of paths and times that returns arrays (paths, instants).

    `paths` are arrays (paths, …), and `times` is an array (…, instants), of which only the dtype is used.
    """
    found: dict[str, Any] = {}
    instant = jax.ShapeDtypeStruct((1, 1), times.dtype)

    def of_path(path: Any) -> dict[str, Array]:
        one = jax.tree.map(lambda x: x[None], path)
        closed, shapes = jax.make_jaxpr(lambda path, t: work(path, (t,)), return_shape=True)(one, instant)
        recorder, leaves = _Recorder(), jax.tree.leaves(one)
        outputs = recorder.run(closed.jaxpr, closed.consts, [*leaves, Step()])
        found["results"] = [recorder.operand(x) for x in outputs]
        found["kinds"], found["structure"] = [x.dtype for x in closed.out_avals], jax.tree.structure(shapes)
        found["elementwise"] = recorder.elementwise
        return {kind: jnp.stack(values) for kind, values in recorder.constants.items()}

    jax.eval_shape(jax.vmap(of_path), paths)
    return Formulas(jax.vmap(of_path), **found)


class _Recorder:
    """Evaluates operations that depend only on the path, and records those that depend on the instant."""

    def __init__(self) -> None:
        self.constants: dict[str, list[Array]] = {}
        self.known: dict[int, tuple[Any, OfPath]] = {}
        self.elementwise = True

    def run(self, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Any]) -> list[Any]:
        values = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))
        number: Any = lambda x: np.asarray(x.val, x.aval.dtype)  # noqa: E731
        read = lambda x: number(x) if isinstance(x, Literal) else values[x]  # noqa: E731
        for equation in jaxpr.eqns:
            found = self._evaluated(equation, [read(x) for x in equation.invars])
            values.update(zip(equation.outvars, found, strict=True))
        return [read(x) for x in jaxpr.outvars]

    def _evaluated(self, equation: Any, operands: list[Any]) -> Sequence[Any]:
        primitive, params = equation.primitive, equation.params
        inner = params.get("call_jaxpr") or params.get("jaxpr")
        if primitive.name in ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "remat2", "checkpoint"):
            closed = (inner, ()) if not hasattr(inner, "consts") else (inner.jaxpr, inner.consts)
            return self.run(*closed, operands)
        if any(isinstance(x, Step) for x in operands):
            return self._recorded(equation, operands)
        if isinstance(operands[0] if operands else None, np.ndarray) and operands[0].size == 1:
            if primitive.name == "convert_element_type":
                return [operands[0].astype(params["new_dtype"])]
            if primitive.name == "broadcast_in_dim":
                whole, shape = operands[0].reshape(()), params["shape"]
                return [np.full(shape, whole) if np.prod(shape) == 1 else jnp.full(shape, whole)]
        results = primitive.bind(*operands, **params)
        return results if primitive.multiple_results else [results]

    def _recorded(self, equation: Any, operands: list[Any]) -> list[Any]:
        name, outputs = equation.primitive.name, equation.outvars
        single = all(np.prod(x.aval.shape) == 1 for x in (*equation.invars, *outputs))
        if name in UNCHANGED and single:
            return list(operands[: len(outputs)])
        if name not in ELEMENTWISE or not single:
            self.elementwise = False
            return [Step(equation.primitive, equation.params) for _ in outputs]
        return [Step(equation.primitive, equation.params, [self.operand(x) for x in operands])]

    def operand(self, x: Any) -> Any:
        """Return a step, a number, or the place of a value among the constants of a path."""
        if isinstance(x, Step):
            return x
        if isinstance(x, np.ndarray | np.generic):
            return np.asarray(x).reshape(())[()] if np.size(x) == 1 else self._stored(jnp.asarray(x))
        return self._stored(x)

    def _stored(self, x: Any) -> Any:
        if x.size != 1:
            self.elementwise = False
            return Step()
        if id(x) not in self.known:
            kind = x.dtype.name
            values = self.constants.setdefault(kind, [])
            self.known[id(x)] = x, OfPath(kind, len(values))
            values.append(x.reshape(()))
        return self.known[id(x)][1]


def _in_order(results: Sequence[Any]) -> list[Step]:
    """Return the steps on which the results depend, each after its operands."""
    order: dict[int, Step] = {}
    stack = [x for x in reversed(results) if isinstance(x, Step)]
    while stack:
        step = stack[-1]
        missing = [x for x in step.operands if isinstance(x, Step) and id(x) not in order and x.primitive is not None]
        if id(step) in order or step.primitive is None or not missing:
            stack.pop()
            if step.primitive is not None:
                order.setdefault(id(step), step)
        else:
            stack.extend(reversed(missing))
    return list(order.values())


def _applied(step: Step, operands: Sequence[Any], shape: tuple[int, ...]) -> Array:
    """Return the result of an operation; numbers and values of a path are broadcast to the instants."""
    full = [jnp.broadcast_to(x, shape) for x in operands]
    if step.primitive is lax.round_p:
        return _rounded(full[0], step.params["rounding_method"])
    return step.primitive.bind(*full, **step.params)


def _rounded(x: Array, method: Any) -> Array:
    """Return x rounded to an integer, with operations that Pallas lowers for GPUs."""
    below = jnp.floor(x)
    rest = x - below
    to_even = method == lax.RoundingMethod.TO_NEAREST_EVEN  # otherwise away from zero
    halfway_up = below - 2 * jnp.floor(0.5 * below) == 1 if to_even else x > 0
    return jnp.where((rest > 0.5) | ((rest == 0.5) & halfway_up), below + 1, below)
