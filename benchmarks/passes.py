"""Count how often compiled evaluations read each instant, and how often they compute the same values.

    python -m benchmarks.passes [--instants 16384]

The default outputs of one spiral-helix are compiled for the CPU in two ways: as separate arrays, as for a GPU, and in
one loop, as `evaluate` does on a CPU (`qtraj/algebra/cpu/one_loop.py`). The counts come from the compiler's own dump
(`compiled.as_text()`), and are those of arrays with one number for each instant. They show what XLA's compiler for CPUs
does; its compiler for GPUs fuses by rules of its own, and its dump needs a GPU. What that compiler receives is exported
without one: in this program, no operation is repeated.
"""

import argparse
import re
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

import qtraj as qt
from qtraj.algebra.cpu.one_loop import in_one_loop
from qtraj.batch.channels import channels
from qtraj.batch.evaluate import DEFAULT_OUTPUTS

from .races.evaluation import helix

ARITHMETIC = ("add", "subtract", "multiply")
OPERATION = re.compile(r"%(?P<name>[\w.-]+) = (?P<shape>\(.*?\)|\S+) (?P<kind>[a-z-]+)\((?P<operands>[^)]*)")
COMPUTATION = re.compile(r"^(?P<entry>ENTRY )?%[\w.-]+ \(.*\{$")


class Counts(NamedTuple):
    """The loops over all instants, those that read the times, the arrays that they read and write, and operations."""

    loops: int
    loops_that_read_the_times: int
    arrays_read: int
    arrays_written: int
    additions_and_multiplications: int


def compiled_counts(text: str, instants: int) -> Counts:
    """Return the counts of optimised HLO whose parameter with one number for each instant contains the times."""
    lines = list(_operations(text))
    shape = re.compile(rf"\[(?:1,)?{instants}\]")
    entry = [x for in_entry, x in lines if in_entry]
    long = {x["name"] for x in entry if shape.search(x["shape"])}
    times = {x["name"] for x in entry if x["name"] in long and x["kind"] == "parameter"}
    loops = [x for x in entry if x["kind"] in ("fusion", "reduce") and shape.search(x["shape"])]
    read = [long.intersection(re.findall(r"%([\w.-]+)", x["operands"])) for x in loops]
    used = Counter(x["kind"] for _, x in lines if shape.search(x["shape"]))
    written = sum(len(shape.findall(x["shape"])) for x in loops)
    arithmetic = sum(used[kind] for kind in ARITHMETIC)
    return Counts(len(loops), sum(bool(x & times) for x in read), sum(map(len, read)), written, arithmetic)


def _operations(text: str) -> Iterator[tuple[bool, dict[str, str]]]:
    """Yield each operation, and whether it belongs to the program itself rather than to the body of a loop."""
    in_entry = False
    for line in text.splitlines():
        if start := COMPUTATION.match(line):
            in_entry = bool(start["entry"])
        elif found := OPERATION.search(line):
            yield in_entry, found.groupdict()


def exported_arithmetic(text: str, instants: int) -> int:
    """Return the number of additions and multiplications of arrays of instants in StableHLO."""
    return len(re.findall(rf"stablehlo\.(?:{'|'.join(ARITHMETIC)}) .*tensor<(?:1x)?{instants}xf64>", text))


def measured(instants: int) -> tuple[int, dict[str, Counts]]:
    """Return the arithmetic of the program for CUDA, and the counts of both ways to compile it for the CPU."""
    path, times = jax.tree.map(jnp.asarray, helix("float64")), jnp.linspace(0.0, 4.0, instants)
    separate, joined = (jax.jit(_components(join)) for join in (list, in_one_loop))
    exported = jax.export.export(separate, platforms=("cuda",))(path, times).mlir_module()
    calls = {"separate arrays": separate, "in one loop": joined}
    found = {name: call.lower(path, times).compile().as_text() or "" for name, call in calls.items()}
    return exported_arithmetic(exported, instants), {name: compiled_counts(x, instants) for name, x in found.items()}


def _components(join: Callable[[Any], Any]) -> Callable[..., Any]:
    """Return a function of a path and times (instants,) that computes the components of the default outputs."""

    def outputs(path: qt.SpiralHelix, times: Any) -> Any:
        paths = jax.tree.map(lambda x: x[None], path)
        return join(jax.tree.leaves(channels(paths, times[None], (qt.Natural(), "body", None), DEFAULT_OUTPUTS)))

    return outputs


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.passes", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--instants", type=int, default=16_384)
    instants = parser.parse_args().instants
    if instants < 2:
        parser.error(f"--instants must be at least 2, but {instants} was given")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")
    given, found = measured(instants)
    print(f"{instants} instants, jax {jax.__version__}, compiled for the CPU")
    print("|", *(name.replace("_", " ") + " |" for name in ("", *Counts._fields)))
    print("|" + " --- |" * (len(Counts._fields) + 1))
    for name, counts in found.items():
        print(f"| {name} |", *(f"{x} |" for x in counts))
    print(f"additions and multiplications in the program that XLA receives for CUDA: {given}")


if __name__ == "__main__":
    main()
