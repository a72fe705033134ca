"""Run the benchmarks, print their tables, and save them as JSON with the machine and the package versions.

    python -m benchmarks                        all benchmarks; this takes minutes on an otherwise idle machine
    python -m benchmarks evaluation bandwidth   only these; the file keeps the results of the others
    python -m benchmarks --quick                small sizes and few rounds, to check that everything runs
    python -m benchmarks --write                also update the tables and figures in docs/performance.md
    python -m benchmarks device --write         measure an accelerator (see benchmarks/device.py)

The results are written to benchmarks/results/<name>.json after each benchmark; with --quick, the file is in a temporary
folder. The default name is the type of device. The documents use only benchmarks/results/cpu.json.
"""

import argparse
import importlib.metadata
import json
import os
import shlex
import sys
import tempfile
import time
from pathlib import Path

import jax
import pytest

from .races import RACES
from .report import RESULTS, printed, write

VERSIONS = ("jax", "jaxlib", "numpy", "scipy", "equinox", "diffrax", "jaxlie")


def main():
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("races", nargs="*", metavar="BENCHMARK", help=f"{', '.join(RACES)}; default: all")
    parser.add_argument("--quick", action="store_true", help="small sizes and few rounds")
    parser.add_argument("--name", default=jax.default_backend(), help="name of the results file")
    parser.add_argument("--folder", type=Path, help="folder of the results file (temporary with --quick)")
    parser.add_argument("--write", action="store_true", help="also update the docs with these results")
    given = parser.parse_args()
    if unknown := [name for name in given.races if name not in RACES]:
        parser.error(f"unknown benchmark {unknown[0]!r}; the known benchmarks are {', '.join(RACES)}")
    if given.write and (given.quick or given.name != RESULTS.stem or given.folder):
        parser.error(
            f"the documents use only {RESULTS.name}, so --write takes no --quick, no --folder and no other --name"
        )
    folder = given.folder or (Path(tempfile.mkdtemp(prefix="qtraj-benchmarks-")) if given.quick else RESULTS.parent)
    folder.mkdir(parents=True, exist_ok=True)
    file, failed = folder.resolve() / f"{given.name}.json", 0
    results = {"races": {}}
    for name in given.races or RACES:
        with tempfile.TemporaryDirectory() as scratch:
            found, code = measured([name], given.quick, Path(scratch) / "raw.json")
        failed = failed or code
        if name not in found["races"]:
            print(f"\n{name}: failed, and nothing was recorded", file=sys.stderr, flush=True)
            failed = failed or 1
            continue
        print(printed(found), flush=True)
        if file.exists():
            results = json.loads(file.read_text(encoding="utf-8"))
        races = results["races"] | found["races"]
        results = {"races": {name: races[name] for name in RACES if name in races}}
        file.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if results["races"]:
        print(f"\nwritten: {file}")
        if given.write:
            write(results)
    return failed


def measured(names, quick, raw):
    """Run the benchmarks; return their results with a description of the machine, and pytest's exit code."""
    if quick:
        os.environ["QTRAJ_BENCHMARKS_QUICK"] = "1"
    chosen = [f"benchmarks/test_races.py::test_race[{name}]" for name in names]
    options = ["-n", "0", "-W", "default", "-q", "--benchmark-json", str(raw), "--benchmark-quiet"]
    os.chdir(Path(__file__).parents[1])
    load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
    failed = int(pytest.main([*chosen, *options]))
    report = raw.read_text(encoding="utf-8") if raw.exists() else ""
    return (gathered(json.loads(report), names, load) if report else {"races": {}}), failed


def gathered(raw, names, load):
    """Convert pytest-benchmark's report to the stored form; `load` is the system load before the run."""
    machine, cpu = raw["machine_info"], raw["machine_info"].get("cpu", {})
    command = shlex.join(["python", "-m", "benchmarks", *sys.argv[1:]])
    made = {"command": command, "date": raw["datetime"][:10], "device": device(), "machine": system(machine, cpu, load)}
    races = {}
    for entry in raw["benchmarks"]:
        info = entry["extra_info"]
        if "race" not in info:
            continue
        table = {key: info[key] for key in ("title", "rows", "settings")}
        races[info["race"]] = table | {"seconds": round(entry["stats"]["mean"], 1), "made": made}
    return {"races": {name: races[name] for name in names if name in races}}


def device():
    """Describe the devices that JAX uses."""
    found = jax.devices()
    return f"{len(found)} × {found[0].device_kind} ({found[0].platform})"


def system(machine, cpu, load):
    """Describe the processor, the system load before the run, Python and the packages."""
    versions = {name: importlib.metadata.version(name) for name in VERSIONS}
    return {
        "processor": cpu.get("brand_raw", machine["machine"]),
        "cores": os.cpu_count(),
        "load_before": load,
        "python": machine["python_version"],
        "system": machine["system"],
        "versions": versions,
    }


def on_device(arguments):
    """Run the benchmark of an accelerator, which needs few packages."""
    from .device import main

    return main(arguments)


if __name__ == "__main__":
    begun = time.perf_counter()
    code = on_device(sys.argv[2:]) if sys.argv[1:2] == ["device"] else main()
    print(f"{time.perf_counter() - begun:.0f} s in total")
    sys.exit(code)
