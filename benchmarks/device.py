"""Measure what an accelerator is used for, and check the values against those of the CPU, in less than five minutes.

    PYTHONPATH=src python -m benchmarks device            print the table, and write results/<device>.json
    PYTHONPATH=src python -m benchmarks device --write    also update docs/performance.md
    PYTHONPATH=src python -m benchmarks device --quick    small sizes, to check that everything runs

Only jax, equinox, diffrax, optax, jaxtyping, numpy, scipy and pytest need to be installed. The results are written
after every row, so a run that is interrupted loses only the rest.
"""

import argparse
import datetime
import json
import os
import platform
import re
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax

import qtraj as qt
from qtraj.batch.kernel_choice import VARIABLE

from .accuracy.tables import put
from .evaluation.reference import ANGLE, DURATION, HEIGHT, RADIUS
from .loops import with_diffrax, with_qtraj
from .race import race
from .races.bandwidth import CHANNELS, copy_rate
from .races.evaluation import helix
from .report import DOCUMENT, RESULTS, body, text as shown

CHECKED = 4096
"""Number of instants whose values are compared with those of NumPy."""


class Found(NamedTuple):
    """The times of a call [s], the largest difference to the reference, its bound, and the bytes that are moved."""

    spent: list[float]
    difference: float
    bound: float
    moved: float | None = None
    first: float | None = None


def many(count: int, kind: Any = "float64") -> qt.SpiralHelix:
    """Return a batch of paths of different sizes."""
    one = helix(kind)
    scale = jnp.linspace(1.0, 1.1, count, dtype=kind)
    return jax.vmap(lambda c: qt.SpiralHelix(one.radius * c, one.angle, one.height, one.duration))(scale)


def on_host(tree: Any) -> Any:
    """Return the tree with its arrays as NumPy arrays in float64."""
    return jax.tree.map(lambda x: np.asarray(x, np.float64) if eqx.is_array(x) else x, tree)


def difference(found: Any, expected: Any) -> float:
    """Return the largest difference of any output, relative to the largest value of the output."""
    pairs = zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)
    parts = [(np.asarray(x, np.float64), np.asarray(y, np.float64)) for x, y in pairs]
    return max(float(np.max(np.abs(x - y)) / max(np.max(np.abs(y)), 1e-300)) for x, y in parts)


def timed(call: Any, rounds: int) -> tuple[list[float], float]:
    """Return the times of warm calls and of the first one [s]."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    first = time.perf_counter() - start
    return race({"": call}, rounds, warm=False)[""], first


def evaluation(kind: str, count: int, instants: int, reduce: str | None, rounds: int, kernel: str = "off") -> Found:
    """Evaluate the default outputs for one path or many, and compare a part of them with NumPy.

    `kernel` chooses XLA, the fused kernel, or its slow interpreter.
    """
    os.environ[VARIABLE] = kernel
    try:
        return _evaluation(kind, count, instants, reduce, rounds)
    finally:
        del os.environ[VARIABLE]


def _evaluation(kind: str, count: int, instants: int, reduce: str | None, rounds: int) -> Found:
    path = helix(kind) if count == 1 else many(count, kind)
    times = jnp.linspace(0.0, DURATION, instants, dtype=kind)
    call = lambda: qt.evaluate(path, times, reduce=reduce).values  # noqa: E731
    spent, first = timed(call, rounds)
    table = call()
    size = np.dtype(kind).itemsize
    bound = 1e-11 if kind == "float64" else 2e-4
    chosen = on_host(path if count == 1 else jax.tree.map(lambda x: x[count // 2], path))
    os.environ[VARIABLE] = "off"  # the reference
    if reduce is None:
        every = max(1, instants // CHECKED)
        rows = jax.tree.map(lambda x: x if count == 1 else x[count // 2], table)
        found = {name: np.asarray(x)[::every] for name, x in rows.items()}
        expected = qt.evaluate(chosen, np.asarray(times, np.float64)[::every]).values
        moved = (CHANNELS * count * instants + instants) * size
    else:
        found = {name: np.asarray(x) for name, x in table.items()}
        found = found if count == 1 else {name: x[count // 2] for name, x in found.items()}
        step = max(1, instants // 60_000)
        samples = qt.evaluate(chosen, np.asarray(times, np.float64)[::step]).values
        expected = {name: np.max(np.asarray(x), axis=0) for name, x in samples.items()}
        bound = max(bound, 3e-3)  # the reference has fewer instants, and a quaternion may change its sign
        found.pop("quaternion"), expected.pop("quaternion")
        moved = None
    return Found(spent, difference(found, expected), bound, moved, first)


def trihedra(instants: int, rounds: int) -> Found:
    """Compute the natural trihedron of one path at many instants by the user's own `jit(vmap(…))`."""
    path, times = helix("float64"), jnp.linspace(0.0, DURATION, instants)
    call = jax.jit(jax.vmap(qt.trihedral, (None, 0)))
    spent, first = timed(lambda: call(path, times), rounds)
    every = max(1, instants // CHECKED)
    found = jax.tree.map(lambda x: np.asarray(x)[::every], call(path, times).curvature)
    expected = qt.evaluate(on_host(path), np.asarray(times)[::every], ("curvature",)).curvature
    return Found(spent, difference(found, expected), 1e-11, None, first)


def loss(instants: int, gradient: bool, rounds: int) -> Found:
    """Compute the mean squares of two quantities along one path, and their gradient in its coefficients."""
    times = jnp.linspace(0.0, DURATION, instants)

    def value(radius: Any, times: Any) -> Any:
        table = qt.evaluate(qt.SpiralHelix(radius, ANGLE, HEIGHT, DURATION), times, ("curvature", "speed"))
        return jnp.mean(table.curvature**2) + jnp.mean(table.speed**2)

    call = jax.jit(jax.value_and_grad(value) if gradient else value)
    radius = jnp.asarray(RADIUS)
    spent, first = timed(lambda: call(radius, times), rounds)

    def reference(radius: Any) -> float:
        path = qt.SpiralHelix(np.asarray(radius), ANGLE, HEIGHT, DURATION)
        table = qt.evaluate(path, np.linspace(0.0, DURATION, min(instants, 60_000)), ("curvature", "speed"))
        return float(np.mean(np.square(table.curvature)) + np.mean(np.square(table.speed)))

    expected: Any = reference(RADIUS)
    if gradient:
        steps = 1e-5 * np.eye(len(RADIUS))
        slopes = [(reference(RADIUS + h) - reference(RADIUS - h)) / 2e-5 for h in steps]
        expected = (expected, np.array(slopes))
    return Found(spent, difference(call(radius, times), expected), 1e-4, None, first)


def proofs(count: int, rounds: int) -> Found:
    """Prove two limits of many paths, which runs on the CPU wherever the paths are."""
    paths, limits = many(count), qt.Limits(curvature=0.06, speed=12.0)
    spent, first = timed(lambda: qt.certify(paths, limits).code, rounds)
    alone = qt.certify(on_host(jax.tree.map(lambda x: x[count // 3], paths)), limits)
    found = qt.certify(paths, limits)
    wrong = float(np.asarray(found.code)[count // 3] != np.asarray(alone.code))
    return Found(spent, wrong, 0.0, None, first)


def propagation(count: int, rounds: int) -> Found:
    """Propagate many attitudes under their own rates, and compare with the rotation about a fixed axis."""
    rates = jnp.linspace(0.5, 1.5, count)
    times = jnp.linspace(0.0, 5.0, 11)
    start = jnp.asarray([1.0, 0.0, 0.0, 0.0])

    def one(size: Any) -> Any:
        rate = lambda t: size * jnp.stack([0 * t, 0 * t, 1 + jnp.sin(t)])  # noqa: E731
        return qt.propagate(rate, start, times)

    call = jax.jit(jax.vmap(one))
    spent, first = timed(lambda: call(rates), rounds)
    angle = np.asarray(rates)[:, None] * (np.asarray(times) + 1 - np.cos(np.asarray(times)))
    zero = np.zeros_like(angle)
    expected = np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)
    return Found(spent, difference(call(rates), expected), 1e-10, None, first)


def loops(count: int, rounds: int) -> Found:
    """Simulate many closed loops of 20 s, and compare their errors with the closed form."""
    program = qt.FrameProgram(qt.SpiralHelix([20.0, 1.0], ANGLE, [1.0, 0.4], 20.0))
    law, times = qt.AccelerationLaw(2.0, 1.5), jnp.linspace(0.0, 20.0, 21)
    begin = program(0.0)
    signs = jnp.linspace(-0.3, 0.3, count)

    def one(c: Any) -> Any:
        q = qt.quaternion.product(jnp.asarray(begin.quaternion), jnp.stack([1 - 0 * c, c, -c, 0.5 * c]))
        rate = jnp.concatenate([jnp.zeros(1), jnp.asarray(begin.rate)])
        return qt.simulate(program, law, q, rate, times).error

    call = jax.jit(jax.vmap(one))
    spent, first = timed(lambda: call(signs), rounds)
    cpu = jax.local_devices(backend="cpu")[0]
    with jax.default_device(cpu):
        few = jax.device_put(signs[:: max(1, count // 4)], cpu)
        expected = jax.jit(jax.vmap(one))(few)
    return Found(spent, difference(call(signs)[:: max(1, count // 4)], expected), 1e-7, None, first)


def stiff_loops(count: int, how: str, rounds: int) -> Found:
    """Simulate loops of very different stiffness, and compare a few with the CPU; see `benchmarks.loops`."""
    rng = np.random.default_rng(7)
    gains, errors = 10 ** rng.uniform(0, 2, count), rng.uniform(-0.3, 0.3, count)
    mapped = jax.jit(jax.vmap(with_diffrax if how == "diffrax" else with_qtraj))
    in_blocks = partial(qt.in_blocks, with_qtraj, gains, errors, cost=gains)
    call = in_blocks if how == "in_blocks" else lambda: mapped(jnp.asarray(gains), jnp.asarray(errors))
    spent, first = timed(call, rounds)
    every = max(1, count // 4)
    with jax.default_device(jax.local_devices(backend="cpu")[0]):
        expected = jax.jit(jax.vmap(with_qtraj))(gains[::every], errors[::every])
    return Found(spent, difference(np.asarray(call())[::every], expected), 1e-7, None, first)


def tunings(count: int, method: Any, rounds: int) -> Found:
    """Tune many paths, and compare a few of them with their tuning alone."""
    k = jnp.linspace(0.0, 1.0, count)
    starts = jax.vmap(lambda k: qt.BoundaryState(jnp.stack([20 + k, 0 * k, 0 * k]), jnp.stack([1 + 0 * k, 7 + k, k])))(
        k
    )
    ends = jax.vmap(lambda k: qt.BoundaryState(jnp.stack([0 * k, 28 - k, 1 + k]), jnp.stack([k - 10, -1 + 0 * k, k])))(
        k
    )
    limits = qt.Limits(curvature=0.048, lateral_acceleration=2.2)
    call = lambda: qt.tune(starts, ends, limits, method=method)  # noqa: E731
    spent, first = timed(lambda: call().objective, rounds)
    at = count // 2
    alone = qt.tune(*jax.tree.map(lambda x: np.asarray(x[at]), (starts, ends)), limits)
    return Found(spent, abs(float(np.asarray(call().objective)[at]) / float(alone.objective) - 1), 1e-6, None, first)


def tasks(quick: bool, on_cpu: bool) -> dict[str, Any]:
    """Return the calls by the labels of their rows; sizes are smaller on a CPU."""
    less = 1000 if quick else 20 if on_cpu else 1
    instants, paths, rounds = 40_000_000 // less, max(10, 100_000 // less), 3 if quick or on_cpu else 7
    rows: dict[str, Any] = {}
    for kind in ("float64", "float32"):
        one, batch = f"evaluate, one path × {instants}, {kind}", f"evaluate, {paths} paths × 1000, {kind}"
        rows[one] = partial(evaluation, kind, 1, instants, None, rounds)
        rows[batch] = partial(evaluation, kind, paths, 1000, None, rounds)
        rows[f'{one}, reduce="max"'] = partial(evaluation, kind, 1, instants, "max", rounds)
        rows[f'{batch}, reduce="max"'] = partial(evaluation, kind, paths, 1000, "max", rounds)
        for choice in ["interpret"] * (quick and kind == "float64") if on_cpu else ["on"]:
            rows[f"{one}, kernel"] = partial(evaluation, kind, 1, instants, None, rounds, choice)
            rows[f"{batch}, kernel"] = partial(evaluation, kind, paths, 1000, None, rounds, choice)
            rows[f'{one}, reduce="max", kernel'] = partial(evaluation, kind, 1, instants, "max", rounds, choice)
            rows[f'{batch}, reduce="max", kernel'] = partial(evaluation, kind, paths, 1000, "max", rounds, choice)
    few, bodies = instants // 10, max(10, 10_000 // less)
    rows[f"jit(vmap(trihedral)), {few}"] = partial(trihedra, few, rounds)
    rows[f"a loss over {few} instants"] = partial(loss, few, False, rounds)
    rows[f"its value and gradient, {few}"] = partial(loss, few, True, rounds)
    rows[f"certify, {bodies} paths × 2 limits (on the CPU)"] = partial(proofs, bodies, 2)
    rows[f"propagate, {bodies} bodies × 5 s"] = partial(propagation, bodies, 2)
    rows[f"simulate, {bodies} loops × 20 s"] = partial(loops, bodies, 2)
    stiff = max(10, bodies // 10)
    for how in ("jit(vmap)", "in_blocks", "diffrax"):
        rows[f"simulate, {stiff} loops of different stiffness, {how}"] = partial(stiff_loops, stiff, how, 2)
    tuned = max(4, 1000 // less)
    rows[f"tune, {tuned} problems, sqp (on the CPU)"] = partial(tunings, tuned, "sqp", 2)
    rows[f"tune, {tuned} problems, optax.adam(1e-2)"] = partial(tunings, tuned, optax.adam(1e-2), 1)
    return rows


COLUMNS = ("call", "time [ms]", "first call [s]", "fraction of the copy", "largest difference to the CPU", "agrees")


def row(label: str, found: Found, rate: float) -> dict[str, Any]:
    """Return a row of the table."""
    median = float(np.median(found.spent))
    part = "—" if found.moved is None else found.moved / median / rate
    agrees = "yes" if found.difference <= found.bound else f"no, more than {found.bound:g}"
    cells = (label, 1e3 * median, found.first, part, found.difference, agrees)
    return dict(zip(COLUMNS, cells, strict=True))


def name() -> str:
    """Return the name of the device as the name of a file, such as "nvidia-h200"."""
    return re.sub(r"[^a-z0-9]+", "-", jax.devices()[0].device_kind.lower()).strip("-")


def made() -> dict[str, Any]:
    """Describe the device, the machine and the packages."""
    devices = jax.devices()
    machine = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "system": platform.system(),
        "versions": {x.__name__: x.__version__ for x in (jax, np, optax, eqx)},
    }
    return {
        "command": "python -m benchmarks device --write",
        "date": str(datetime.datetime.now().astimezone().date()),
        "device": f"{len(devices)} × {devices[0].device_kind} ({devices[0].platform})",
        "machine": machine,
    }


def measured(quick: bool, keep: Any) -> dict[str, Any]:
    """Run all tasks; `keep` receives the results after every row. A task that fails is a row that says so."""
    on_cpu = jax.default_backend() == "cpu"
    rate = copy_rate(80 if quick else 800 if on_cpu else 4000, 3 if quick else 7)
    title = "Medians of warm calls; the values are compared with those of the CPU"
    rows, settings, begun = [], {"copy [GB/s]": rate * 1e-9}, time.perf_counter()
    result: dict[str, Any] = {"title": title, "rows": rows, "settings": settings, "made": made()}
    for label, task in tasks(quick, on_cpu).items():
        try:
            rows.append(row(label, task(), rate))
        except Exception as error:  # one failure must not lose the other measurements
            fault = f"{type(error).__name__}: {error}".splitlines()[0][:200]
            rows.append(dict.fromkeys(COLUMNS, "—") | {COLUMNS[0]: label, COLUMNS[-1]: fault})
        result["seconds"] = round(time.perf_counter() - begun, 1)
        print(f"{result['seconds']:6.1f} s ", *(shown(x) for x in rows[-1].values()), sep="  ", flush=True)
        keep(result)
    return result


def main(arguments: list[str]) -> int:
    """Run `python -m benchmarks device`, and return the exit code: 1 if a task failed or a value differs."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks device", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small sizes and few rounds")
    parser.add_argument("--write", action="store_true", help="also update docs/performance.md")
    parser.add_argument("--folder", type=Path, help="folder of the results file (temporary with --quick)")
    given = parser.parse_args(arguments)
    if given.write and (given.quick or given.folder or jax.default_backend() == "cpu"):
        parser.error("only measurements of an accelerator, in full, are written into documents")
    jax.config.update("jax_enable_x64", True)
    folder = given.folder or (Path(tempfile.mkdtemp(prefix="qtraj-benchmarks-")) if given.quick else RESULTS.parent)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name()}.json"

    def keep(result: dict[str, Any]) -> None:
        text = json.dumps({"races": {"device": result}}, indent=1, ensure_ascii=False)
        file.write_text(text + "\n", encoding="utf-8")

    result = measured(given.quick, keep)
    print(f"\nwritten: {file}")
    if given.write:
        DOCUMENT.write_text(put(DOCUMENT.read_text(encoding="utf-8"), "device", body(result)), encoding="utf-8")
    return int(any(row[COLUMNS[-1]] != "yes" for row in result["rows"]))
