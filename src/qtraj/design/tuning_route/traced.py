"""The search for a route, and the system of its derivatives, as operations of JAX that run in NumPy on the host.

Inside `jit` and `vmap`, the number of segments of a route may be unknown, because routes have padding. Arrays then have
one entry for each row of the route: segments of padding do not change, and have no constraints.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits, limits_of
from qtraj.design.on_host import on_host
from qtraj.design.proof.certificate import UNDEFINED, Certificate
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.solve.chain import Border, Chain
from qtraj.design.solve.nonconvex import Iterate
from qtraj.design.solve.polishing import polished, solution
from qtraj.design.tuning.clearances import Clearances
from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.constraints import contain_position
from qtraj.design.tuning_route.curves import Curves, curves_of
from qtraj.design.tuning_route.problem import BLOCK, OF_SEGMENTS
from qtraj.design.tuning_route.program import RouteProgram
from qtraj.design.tuning_route.scales import is_shifted
from qtraj.design.tuning_route.solution import (
    CHANGED,
    CONTRADICTED,
    UNCHANGED,
    Data,
    Searched,
    Solution,
    Solve,
    Structure,
)
from qtraj.foundation.arrays import concrete, constants, is_traced
from qtraj.foundation.outcome import ResultCode
from qtraj.path.driving import segments_of
from qtraj.path.route import Route, from_segments
from qtraj.path.route_parts import unpadded

_OF_JOINTS = ("free", "axes")


class Facts(NamedTuple):
    """What a result contains besides the route: arrays for each segment, the certificates, the code and the steps.

    `segments` and `whole` are the codes, times, values and limits of the certificates.
    """

    distance: Any
    within: Any
    kept: Any
    segments: tuple[Any, ...]
    whole: tuple[Any, ...]
    code: Any
    iterations: Any

    def certificate(self, names: tuple[str, ...], starts: Any) -> RouteCertificate:
        """Return the certificate, which has no intervals of violation."""
        whole, parts = (Certificate(names, *x) for x in (self.whole, self.segments))
        return RouteCertificate(whole, parts, starts, None)


class Refined(NamedTuple):
    """A refined search: variables, multipliers and their ratios to the slacks, the matrix, and whether it converged."""

    z: Any
    multipliers: tuple[Any, Any]
    stiffness: tuple[Any, Any]
    matrix: Chain
    done: Any


def structure(route: Route, limits: Limits, names: tuple[str, ...], kind: str, closed: bool) -> Structure:
    """Return the structure of the problem of a route with limits, both of which may be traced.

    **Raises:** ValueError for a route with stops of `fit_route`, or a closed route, whose structure is unknown.
    """
    known, obstacles = constants(route), None
    if limits.keep_out is not None:
        obstacles = Clearances(limits.keep_out, limits.body)
    own = {name: x for name, x in limits.given().items() if isinstance(x, OfSpeed)}
    parameters = len(limits.road(float).numbers) if limits.uses_vehicle else 0
    if not is_traced(known):
        return Structure(names, kind, curves_of(segments_of(known)), closed, parameters, False, obstacles, own)
    if route.progress is not None:
        raise ValueError(
            "inside jit and vmap, tune_route cannot change the route next to stops of fit_route, because its curves "
            "are unknown: pass this route with concrete values, or differentiate outside jit and vmap"
        )
    starts = concrete(known.starts)
    if closed and starts is None:
        raise ValueError(
            "inside jit and vmap, tune_route needs the number of segments of a closed route: create the route there, "
            "from concrete times of its joints"
        )
    every = np.arange(known.starts.shape[-1] if starts is None else int(np.isfinite(starts).sum()))
    curves = Curves(every, every, np.zeros(every.size, bool), every, np.ones(every.size))
    return Structure(names, kind, curves, closed, parameters, starts is None, obstacles, own)


def solved(s: Structure, data: Data, origin: Any, vehicle: Any, solve: Solve) -> Solution:
    """Return the result of `solve` for concrete data, without padding."""
    built = unpadded(data.starts, data.coefficients, data.duration, origin, data.progress)
    route, count = from_segments(*built), len(built[0])
    tube = tuple(x[: count + 1] if x.ndim else x for x in map(np.asarray, data.tube))
    others = {} if s.obstacles is None else {"keep_out": s.obstacles.keep_out, "body": s.obstacles.body}
    bounds = dict(zip(s.names, np.asarray(data.bounds).tolist(), strict=True)) | s.by_speed
    limits: Limits = limits_of(bounds, vehicle, **others)
    return solve(route, limits, tube)  # type: ignore[arg-type]


def searched(s: Structure, data: Data, origin: Any, vehicle: Any, solve: Solve) -> tuple[Searched, Facts]:
    """Return the result of `solve` for traced data, as an operation that JAX does not differentiate.

    Invalid data lead to NaN and a result code.
    """

    def of_one(data: Data, origin: Any) -> tuple[Searched, Facts]:
        try:
            found = solved(s, data, origin, vehicle, solve)
        except ValueError:  # an error inside a compiled function would have no clear message
            return _failed(shapes)
        own, facts = jax.tree.map(_padded, (as_arrays(s, found), _facts(s, found)), shapes)
        padding = np.arange(facts.within.size) >= len(found.curves.owner)
        return own, facts._replace(within=facts.within | padding)

    shapes = _shapes(s)
    return on_host(_over(of_one), shapes, *constants((data, origin)))


def as_arrays(s: Structure, found: Solution) -> Searched:
    """Return a search without the arrays that its derivatives do not need, and without padding."""
    fields = {name: getattr(found.problem, name) for name in _fields(s)}
    program, at = RouteProgram(found.problem), found.at
    if at is None or at.excess is not None:
        none = program.spread(np.zeros(program.full.size))
        return Searched(fields, found.z, none, none, none, np.asarray(UNCHANGED if at is None else CONTRADICTED))
    slacks, multipliers, margins = (program.spread(x) for x in (at.slacks, at.multipliers, at.margins))
    return Searched(fields, found.z, slacks, multipliers, margins, np.asarray(CHANGED))


def refined(s: Structure, found: Searched) -> Refined:
    """Refine a search until its derivatives are accurate; on the host."""
    curves = len(s.curves.first)

    def of_one(found: Searched) -> Refined:
        if found.state != CHANGED:
            return _zeros(shapes)
        own = _without_padding(s, found)
        program = RouteProgram(s.problem(own.fields))
        flat: Any = (program.flat(*x) for x in (own.slacks, own.multipliers, own.margins))
        at, matrix, done = polished(program, Iterate(own.z, *flat))
        weights, stiffness = (program.spread(x) for x in (at.multipliers, at.multipliers / at.slacks))
        return jax.tree.map(_padded, Refined(at.z, weights, stiffness, matrix, np.asarray(done)), shapes)

    shapes = _refined_shapes(s, curves)
    return on_host(_over(of_one), shapes, found)


def linear_solution(matrix: Chain, right: Any) -> Any:
    """Return the solution of the linear system of the derivatives; on the host."""

    def of_one(matrix: Chain, right: Any) -> Any:
        padding: Any = ~np.asarray(matrix.diagonal).any(axis=(1, 2))
        matrix = matrix._replace(diagonal=matrix.diagonal + padding[:, None, None] * np.eye(BLOCK))
        return solution(matrix, right)

    shape = jax.ShapeDtypeStruct(right.shape, right.dtype)
    return on_host(_over(of_one), shape, matrix, right)


def _over(of_one: Any) -> Any:
    """Return a function of a batch that calls `of_one` for each of its elements."""

    def of_batch(*arguments: Any) -> Any:
        count = len(jax.tree.leaves(arguments)[0])
        found = [of_one(*jax.tree.map(lambda x: x[k], arguments)) for k in range(count)]  # noqa: B023
        return jax.tree.map(lambda *x: np.stack(x), *found)

    return of_batch


def _without_padding(s: Structure, found: Searched) -> Searched:
    if not s.padded:
        return found
    fields = found.fields
    count = int(np.count_nonzero(fields["durations"]))  # padding has zeros
    own = {name: x[: count + 1] if name in _OF_JOINTS else x for name, x in fields.items()}
    own |= {name: x[..., :count] for name, x in fields.items() if name in OF_SEGMENTS}
    slacks, multipliers, margins = jax.tree.map(lambda x: x[..., :count], found[2:5])
    return Searched(own, found.z[: count + 1], slacks, multipliers, margins, found.state)


def _facts(s: Structure, found: Solution) -> Facts:
    result, certificate = found.result, found.result.certificate
    order = [certificate.names.index(name) for name in s.certified]
    whole, parts = (
        tuple(np.asarray(x)[..., order] for x in (c.codes, c.times, c.values, c.limits))
        for c in (certificate.whole, certificate.segments)
    )
    return Facts(result.distance, result.within, result.kept, parts, whole, result.code, result.iterations)


def _fields(s: Structure) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Return the shapes and types of the fields of the problem that the derivatives need."""
    n, nodes, limits = len(s.curves.first), len(basis.NODES), len(s.constraints)
    names = ("durations", "moving", "shortest", "longest", "pace", "jerk", "time", "per_time")
    shapes: dict[str, tuple[tuple[int, ...], Any]] = dict.fromkeys(names, ((n,), float))
    shapes |= {"ends": ((6, 3, n), float), "near": ((6, 6, n), float), "offset": ((3, nodes, n), float)}
    shapes |= {"squares": ((limits,), float), "unit": ((), float), "scale": ((BLOCK,), float)}
    shapes |= {"tube": ((2, nodes, n), float), "used": ((limits + 2, nodes, n), bool)}
    shapes |= {"free": ((n + 1, BLOCK), bool), "axes": ((n + 1, 3, 3), float)}
    if s.composed is not None:
        shapes["rates"] = (3, nodes, n), float
    if contain_position(s.constraints):
        shapes["origins"] = (3, n), float
    if s.clear:
        shapes["reached"] = (len(s.clear), n), bool
    if any(x.track is not None for x in s.clear):
        shapes["starts"] = (n,), float
    if any(map(is_shifted, s.names)):
        shapes["shifts"] = (limits,), float
    if s.parameters:
        shapes["road"] = (s.parameters, len(basis.FINE_NODES), n), float
    return shapes


def _like(shape: tuple[int, ...], kind: Any = float) -> Any:
    return jax.ShapeDtypeStruct(shape, np.dtype(kind))


def _of_constraints(s: Structure) -> tuple[Any, Any]:
    n = len(s.curves.first)
    return _like((len(s.constraints) + 2, len(basis.NODES), n)), _like((2, n))


def _shapes(s: Structure) -> tuple[Searched, Facts]:
    """Return the shapes and types of the results of `searched`."""
    fields = {name: _like(*x) for name, x in _fields(s).items()}
    z, own, limits = _like((len(s.curves.first) + 1, BLOCK)), _of_constraints(s), len(s.certified)
    rows, kinds = len(s.curves.owner), (np.int32, float, float, float)
    parts, whole = (tuple(_like(shape, x) for x in kinds) for shape in ((rows, limits), (limits,)))
    of_rows = _like((rows, 2)), _like((rows,), bool), _like((rows,), bool)
    facts = Facts(*of_rows, parts, whole, _like((), np.int32), _like((), np.int32))
    return Searched(fields, z, own, own, own, _like((), np.int32)), facts


def _refined_shapes(s: Structure, curves: int) -> Refined:
    z, own, block = _like((curves + 1, BLOCK)), _of_constraints(s), (BLOCK, BLOCK)
    border = Border(_like(block), _like((curves + 1, *block))) if s.closed else None
    return Refined(
        z, own, own, Chain(_like((curves + 1, *block)), _like((curves, *block)), border), _like((), np.bool_)
    )


def _padded(x: Any, like: Any) -> np.ndarray:
    """Return an array with zeros appended on each axis; as codes, these zeros are PROVED."""
    x = np.asarray(x)
    return (
        x
        if x.shape == like.shape
        else np.pad(x, [(0, size - own) for size, own in zip(like.shape, x.shape, strict=True)])
    )


def _zeros(shapes: Any) -> Any:
    return jax.tree.map(lambda like: np.zeros(like.shape, like.dtype), shapes)


def _failed(shapes: tuple[Searched, Facts]) -> tuple[Searched, Facts]:
    """Return NaN, with the code of invalid data."""

    def missing(like: Any) -> np.ndarray:
        fill = {"f": np.nan, "i": UNDEFINED, "b": False}[like.dtype.kind]
        return np.full(like.shape, fill, like.dtype)

    found, facts = jax.tree.map(missing, shapes)
    code = np.asarray(int(ResultCode.route_ill_posed))
    return found._replace(state=np.asarray(CONTRADICTED)), facts._replace(code=code, iterations=np.asarray(0))
