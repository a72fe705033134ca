"""Measure the processor time of the first call of functions and commands, each in a fresh process without any cache.

    python -m benchmarks.first_answers                   all rows
    python -m benchmarks.first_answers certify "tune"    only rows whose names start so
    python -m benchmarks.first_answers --against DIR     also with the qtraj in DIR/src, in the same run

A row of a Python function is the processor time of all threads in the call, after all imports and after its arguments
exist. A row of a command is the processor time of the whole process and its children; "imports" is the processor time
of a process that only imports the modules which this command has imported. "peak" is the largest resident memory of the
process. The last row of functions is the time and memory of one process that asks many different questions.

`python -m benchmarks --write first_answers` measures the same rows and writes them into docs/performance.md.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from .first_calls import CALLS

ROOT = Path(__file__).parents[1]
README, MODULES = "README's block of Python", "modules.json"

COMMANDS = {
    "qtraj tune": ["tune"],
    "qtraj tune, again": ["tune"],
    "qtraj retime": ["retime"],
    "qtraj route, 8 km": ["route", str(ROOT / "examples" / "bus_route.toml")],
}
"""Arguments of commands; "again" reads what the command before it may have stored."""

ROWS = (*CALLS, *COMMANDS, README)
"""The names of the rows."""

RUN = """
import json, sys
sys.argv[1:] = {arguments}
from qtraj.cli.main import main
try:
    main()
finally:
    json.dump(list(sys.modules), open({file!r}, "w"))
"""
IMPORT = """
import contextlib, importlib, json
for name in json.load(open({file!r})):
    with contextlib.suppress(Exception):
        importlib.import_module(name)
"""


class Spent(NamedTuple):
    """Processor time [s], largest resident memory [MB], and standard output of a process."""

    seconds: float
    memory: float
    output: str


def process(command, source, folder):
    """Run a process with the qtraj in `source`, without settings of JAX, and with its caches in `folder`."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("XLA_", "JAX_"))}
    environment |= {"PYTHONPATH": os.pathsep.join([str(source), str(ROOT)]), "XDG_CACHE_HOME": folder}
    with tempfile.TemporaryFile("w+") as output:
        child = subprocess.Popen([sys.executable, *command], cwd=folder, env=environment, stdout=output)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        text = output.read()
    if child.returncode:
        raise RuntimeError(f"{' '.join(command)[:200]} ended with {child.returncode}:\n{text[-2000:]}")
    return Spent(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3, text)


def of_call(name, source):
    """Return the row of a Python function."""
    with tempfile.TemporaryDirectory() as folder:
        spent = process(["-m", "benchmarks.first_calls", name], source, folder)
    seconds = json.loads(spent.output.splitlines()[-1])
    return {"seconds": seconds, "imports": None, "peak": spent.memory}


def of_command(name, source, folder):
    """Return the row of a command; `folder` contains its caches and results."""
    code = readme() if name == README else RUN.format(arguments=COMMANDS[name], file=str(Path(folder, MODULES)))
    spent = process(["-c", code], source, folder)
    if name == README:
        return {"seconds": spent.seconds, "imports": None, "peak": spent.memory}
    imports = process(["-c", IMPORT.format(file=str(Path(folder, MODULES)))], source, folder)
    return {"seconds": spent.seconds, "imports": imports.seconds, "peak": spent.memory}


def readme():
    """Return the block of Python in the README."""
    return (ROOT / "README.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]


def rows(names, sources):
    """Yield the name of each row, and its results by the name of the source."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = {key: Path(scratch, key) for key in sources}
        for folder in folders.values():
            folder.mkdir()
        for name in names:
            if name in CALLS:
                yield name, {key: of_call(name, source) for key, source in sources.items()}
            else:
                yield name, {key: of_command(name, source, str(folders[key])) for key, source in sources.items()}


def measured(quick):
    """Return the rows of this checkout as dictionaries; if `quick`, only the first one."""
    table = []
    for name, found in rows(ROWS[:1] if quick else ROWS, {"now": ROOT / "src"}):
        one = found["now"]
        imports = "—" if one["imports"] is None else one["imports"]
        row = {"first call": name, "processor [s]": one["seconds"], "imports [s]": imports, "peak [MB]": one["peak"]}
        table.append(row)
    return table


def cells(found):
    """Return the cells of one source: seconds, seconds of imports, and memory."""
    imports = "" if found["imports"] is None else f"{found['imports']:.2f}"
    return [f"{found['seconds']:.3f}", imports, f"{found['peak']:.0f}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", help="beginnings of the names of rows; default: all")
    parser.add_argument("--against", type=Path, help="a checkout whose qtraj is measured, too")
    options = parser.parse_args()
    sources = {} if options.against is None else {"before": options.against.resolve() / "src"}
    sources["now"] = ROOT / "src"
    chosen = [name for name in ROWS if not options.rows or name.startswith(tuple(options.rows))]
    if not chosen:
        parser.error(f"no row starts so; the rows are {', '.join(ROWS)}")
    heads = [f"{key}{part}" for key in sources for part in (" [s]", ", imports [s]", ", peak [MB]")]
    print("| " + " | ".join(["first call", *heads]) + " |")
    print("|---" * (len(heads) + 1) + "|")
    begun = time.perf_counter()
    for name, found in rows(chosen, sources):
        print("| " + " | ".join([name, *(x for one in found.values() for x in cells(one))]) + " |", flush=True)
    print(f"\n{time.perf_counter() - begun:.0f} s in total, system load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
