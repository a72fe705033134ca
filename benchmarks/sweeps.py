"""Measure sweeps: memory and overhead at many points, two workers against one, and stores after kills.

    python -m benchmarks.sweeps                                all measurements; this takes many minutes
    python -m benchmarks.sweeps memory --points 1000000        or tunings, overhead, kills, schedulers, full
    python -m benchmarks.sweeps command --points 10000000    the same by `qtraj sweep`, with two workers
    python -m benchmarks.sweeps kills --workers 20 --clients 5

Each sweep of `memory` and `tunings` runs in a process of its own, whose largest memory is printed. `command` and
`command_tunings` run `qtraj sweep` for scenarios, and print the largest memory of the command and of its workers (on
Linux, from /proc). `overhead` compares
the CPU time of a sweep with that of the bare calls of its function, so other processes hardly change it. Its second
part, the speed of two workers, is a wall time: measure it on an otherwise idle machine. `kills` kills workers with
SIGKILL, and clients with their schedulers, compares the store with that of an undisturbed sweep, byte by byte, and
counts the shards that were computed although they were finished. `full` does the same for a sweep on a file system that
is full until it grows; it mounts a small tmpfs, so it needs the rights to do that (`unshare -rm python -m …`).
"""

import argparse
import contextlib
import filecmp
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

KINDS = ("memory", "tunings", "command", "command_tunings", "overhead", "kills", "schedulers", "full")

FLAT, OVERHEAD = 1.1, 1.1
"""Largest accepted ratios of memory at many points to few points, and of a sweep to the calls of its function."""

SILENT: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

CALLS = """
import os, sys, time
from pathlib import Path
import numpy as np
import qtraj as qt

FOLDER = Path(__file__).parent

def slow(points):
    if len(points["a"]) > 1:
        shard = int(points["a"][0])
        finished = (FOLDER / os.environ["STORE"] / ".sweep/ledger/0" / str(shard)).exists()
        with (FOLDER / "calls").open("a") as file:
            file.write(f"{os.getpid()} {shard} {int(finished)}\\n")
        time.sleep(0.2)
    return {"y": np.sin(points["a"]) * points["x"], "v": np.stack([points["x"]] * 3, 1)}

slow.batch = True

if __name__ == "__main__":
    parameters = {"a": np.arange(SHARDS), "x": qt.sweeps.Normal(0.0, 1.0)}
    options = {"samples": 50, "shard": 50, "retries": 50}
    if sys.argv[1].isdigit():
        options["workers"] = int(sys.argv[1])
    else:
        from distributed import Client

        options["client"] = Client(scheduler_file=sys.argv[1])
    qt.sweep(slow, parameters, FOLDER / os.environ["STORE"], **options)
"""

SCENARIO = """
duration = 4.0
[start]
position = [12.0, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 12.0, 0.0]
velocity = [-5.0, 0.0, 0.0]
[limits]
curvature = 0.12
lateral_acceleration = 2.0
[tune]
motion = "hermite"
starts = 2
[sweep]
run = "RUN"
outputs = ["speed", "curvature", "lateral_acceleration"]
start.speed = {uniform = [4.0, 6.0]}
end.position.y = {uniform = [9.0, 15.0]}
samples = COUNT
shard = SHARD
keep = false
"""
"""A turn whose speed at the start and width are random, for `qtraj sweep`."""


def turn(point):
    """A right-angle turn and its limits."""
    import qtraj as qt

    radius, speed = point["radius"], point["speed"]
    start = qt.BoundaryState([radius, 0.0, 0.0], [0.0, speed, 0.0])
    end = qt.BoundaryState([0.0, radius, 0.0], [-speed, 0.0, 0.0])
    return start, end, qt.Limits(curvature=0.12, lateral_acceleration=2.0)


def alone(kind, count):
    """Run one sweep in this process, and print its CPU seconds and its largest memory [MB]."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import qtraj as qt

    from .test_sweeps import EVALUATED, RADIUS, RATE

    if kind == "memory":
        function, parameters, shard = EVALUATED, {"radius": RADIUS, "rate": RATE}, 2**14
    else:
        function, shard = qt.sweeps.tune(turn, starts=2), 512
        parameters = {"radius": qt.sweeps.Uniform(9.0, 15.0), "speed": qt.sweeps.Uniform(4.0, 6.0)}
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        swept = qt.sweep(function, parameters, Path(folder) / "s", samples=count, shard=shard, keep=False, workers=0)
        found = {
            "good": bool(swept.successful),
            "failed": int(swept.count_failed),
            "seconds": time.process_time() - began,
        }
    print(json.dumps(found | {"memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}))


def flat(kind, few, many):
    """Print and judge the memory at few and at many points."""
    memory = []
    for count in (few, many):
        command = [sys.executable, "-m", "benchmarks.sweeps", "--alone", kind, str(count)]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        memory.append(found["memory"])
        rate = count / found["seconds"]
        print(
            f"{kind}: {count} points, {found['failed']} failed: {found['seconds']:.1f} CPU s, {rate:.0f} points a s, "
            f"largest memory {found['memory']:.0f} MB",
            flush=True,
        )
    print(f"{kind}: the memory at {many} points is {memory[1] / memory[0]:.3f} times that at {few} points", flush=True)
    return memory[1] / memory[0] <= FLAT


class Commanded(NamedTuple):
    """A sweep by the command line: CPU seconds of all its processes, failed points, and largest memories [MB]."""

    seconds: float
    failed: int
    client: float
    worker: float


def commanded(run, count, shard, workers):
    """Run `qtraj sweep` for `SCENARIO`, and return what it took."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.toml"
        file.write_text(SCENARIO.replace("RUN", run).replace("COUNT", str(count)).replace("SHARD", str(shard)))
        command = [sys.executable, "-m", "qtraj", "sweep", str(file), "--out", folder, "--json"]
        before, largest = os.times(), {}
        with (Path(folder) / "printed").open("w+") as printed:
            client = subprocess.Popen([*command, "--workers", str(workers)], stdout=printed, stderr=subprocess.DEVNULL)
            while client.poll() is None:
                for process in _processes(client.pid):
                    largest[process] = max(largest.get(process, 0.0), _peak(process))
                time.sleep(0.2)
            printed.seek(0)
            found, after = json.loads(printed.read()), os.times()
    spent = sum(after[2:4]) - sum(before[2:4])
    own = largest.pop(client.pid)
    return Commanded(spent, found["failed"], own, max(largest.values(), default=0.0))


def _processes(first):
    """Return the numbers of a process and of all those that it started (Linux)."""
    children = "".join(_text(file) for file in Path(f"/proc/{first}/task").glob("*/children")).split()
    return [first, *(x for child in children for x in _processes(int(child)))]


def _peak(process):
    """Return the largest memory of a process so far [MB] (Linux); 0 if it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) / 1024
    return 0.0


def command_line(run, few, many, shard, workers=2):
    """Print and judge the memory of the command and of its workers at few and at many points."""
    found = []
    for count in (few, many):
        found.append(commanded(run, count, shard, workers))
        one = found[-1]
        print(
            f"qtraj sweep, {run}: {count} points, {one.failed} failed: {one.seconds:.1f} CPU s, largest memory of the "
            f"command {one.client:.0f} MB, of a worker {one.worker:.0f} MB",
            flush=True,
        )
    client, worker = (getattr(found[1], x) / getattr(found[0], x) for x in ("client", "worker"))
    print(f"qtraj sweep, {run}: memory {client:.3f} (command) and {worker:.3f} (worker) times that at {few} points")
    return max(client, worker) <= FLAT


def overhead():
    """Run the tests of the overhead and of two workers."""
    command = [sys.executable, "-m", "pytest", "benchmarks/test_sweeps.py", "-n", "0", "-s", "-q"]
    return subprocess.run(command).returncode == 0


class Interrupted(NamedTuple):
    """What happened to an interrupted sweep: the calls, those for finished shards, and whether the store is equal."""

    shards: int
    calls: int
    again: int
    same: bool
    interruptions: str

    @property
    def good(self):
        """Whether the store is that of an undisturbed sweep, and nothing finished was computed again."""
        return self.same and not self.again

    def __str__(self):
        return (
            f"{self.interruptions}; {self.calls} calls for {self.shards} shards, {self.again} of them for finished "
            f"shards; the store is {'' if self.same else 'not '}equal"
        )


def killed_sweep(folder, workers, clients, shards, seed=0):
    """Kill workers and clients of a sweep in `folder` at random, complete it, and compare its store."""
    pick, killed, ended = random.Random(seed), [], 0
    command = _script(folder, shards)
    while True:
        client = subprocess.Popen([*command, "2"], env=_to("cut"), **SILENT)
        before, share = len(_calls(folder)), max(1, shards // (clients + 2))
        while client.poll() is None:
            time.sleep(pick.uniform(0.2, 0.6))
            seen = _calls(folder)
            if ended < clients and len(seen) >= before + share:
                client.kill()
                ended += 1
                break
            if len(killed) < workers and len(seen) > before and seen[-1][0] not in killed:
                killed.append(seen[-1][0])
                _kill(seen[-1][0])
        if client.wait() == 0 and ended >= clients:
            break
    return _compared(folder, shards, f"{len(killed)} workers and {ended} clients with their schedulers were killed")


def killed_schedulers(folder, count, shards, longest=120.0):
    """Kill the separate scheduler of a sweep `count` times, complete the sweep, and compare its store.

    **Raises:** RuntimeError if the client of a killed scheduler does not end within `longest` [s].
    """
    command, file, ended = _script(folder, shards), folder / "scheduler.json", 0
    while True:
        file.unlink(missing_ok=True)
        scheduler = _dask("scheduler", "--scheduler-file", str(file), "--port", "0", "--no-dashboard")
        while not file.exists():
            time.sleep(0.1)
        own = ("--scheduler-file", str(file), "--nthreads", "1", "--no-nanny", "--no-dashboard")
        workers = [_dask("worker", *own, "--death-timeout", "10") for _ in range(2)]
        client = subprocess.Popen([*command, str(file)], env=_to("cut"), **SILENT)
        try:
            enough = len(_calls(folder)) + max(1, shards // (count + 2))
            while client.poll() is None and (ended == count or len(_calls(folder)) < enough):
                time.sleep(0.1)
            if client.poll() is None:
                scheduler.kill()
                ended += 1
            if client.wait(longest) == 0 and ended == count:
                return _compared(folder, shards, f"{ended} separate schedulers were killed")
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"the client has not ended {longest:.0f} s after its scheduler was killed") from None
        finally:
            for process in (client, scheduler, *workers):
                process.kill()
                process.wait()


def _dask(kind, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments], env=_to("cut"), **SILENT
    )


def _to(store):
    """Return the environment of the processes that write a store."""
    return os.environ | {"STORE": store}


def full_disk(folder, shards):
    """Run a sweep on a tmpfs of half its size, then enlarge the tmpfs and complete the sweep; compare its store.

    **Raises:** PermissionError if this process must not mount file systems.
    """
    command, store = _script(folder, shards), folder / "cut"
    store.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={14 * shards}k", "tmpfs", str(store)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        raise PermissionError("a tmpfs cannot be mounted: run as root, or with unshare -rm")
    try:
        first = subprocess.run([*command, "0"], env=_to("cut"), capture_output=True, text=True)
        if "No space left on device" not in first.stderr:
            raise RuntimeError(f"the disk was not full: {first.stderr}")
        subprocess.run(["mount", "-o", f"remount,size={200 * shards}k", str(store)], check=True)
        subprocess.run([*command, "0"], env=_to("cut"), check=True, capture_output=True)
        return _compared(folder, shards, "the disk was full once")
    finally:
        subprocess.run(["umount", str(store)], check=True)


def _script(folder, shards):
    (folder / "script.py").write_text(CALLS.replace("SHARDS", str(shards)))
    return [sys.executable, str(folder / "script.py")]


def _calls(folder):
    """Return the process, the shard, and whether the shard was finished, of each call so far."""
    lines = _text(folder / "calls").splitlines()
    return [tuple(map(int, x.split())) for x in lines if x.count(" ") == 2]


def _compared(folder, shards, interruptions):
    made = _calls(folder)
    subprocess.run([*_script(folder, shards), "0"], env=_to("whole"), check=True, capture_output=True)
    again = sum(finished for _, _, finished in made)
    return Interrupted(shards, len(made), again, _same(folder / "whole", folder / "cut"), interruptions)


def interrupted(name, run):
    """Print and judge an interrupted sweep."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = run(Path(folder))
        except PermissionError as error:
            print(f"{name}: skipped, because {error}", flush=True)
            return True
    print(f"{name}: {found}", flush=True)
    return found.good


def _kill(process):
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


def _text(file):
    with contextlib.suppress(OSError):
        return file.read_text()
    return ""


def _same(one, other):
    files = [sorted(f.relative_to(x) for f in x.rglob("*") if f.is_file()) for x in (one, other)]
    return files[0] == files[1] and all(filecmp.cmp(one / f, other / f, shallow=False) for f in files[0])


def main(arguments):
    """Print the results, and return the number of measurements that fail."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", help=f"{', '.join(KINDS)}; default: all")
    parser.add_argument("--points", type=int, default=10**7, help="number of points of `memory`")
    parser.add_argument("--tunings", type=int, default=10**5, help="number of points of `tunings`")
    parser.add_argument("--few", type=int, default=10**5, help="number of points with which the memory is compared")
    parser.add_argument("--workers", type=int, default=20, help="number of workers to kill")
    parser.add_argument("--clients", type=int, default=5, help="number of clients to kill, and of separate schedulers")
    parser.add_argument("--shards", type=int, default=200, help="number of shards of interrupted sweeps")
    parser.add_argument("--alone", nargs=2, metavar=("KIND", "COUNT"), help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.alone:
        return alone(given.alone[0], int(given.alone[1]))
    few_tunings = min(max(given.tunings // 10, 5000), given.tunings)  # some shards for each worker
    measurements = {
        "memory": lambda: flat("memory", min(given.few, given.points), given.points),
        "tunings": lambda: flat("tunings", max(given.tunings // 10, 1), given.tunings),
        "command": lambda: command_line("evaluate", min(given.few, given.points), given.points, 2**14),
        "command_tunings": lambda: command_line("tune", few_tunings, given.tunings, 512),
        "overhead": overhead,
        "kills": lambda: interrupted("kills", lambda x: killed_sweep(x, given.workers, given.clients, given.shards)),
        "schedulers": lambda: interrupted("schedulers", lambda x: killed_schedulers(x, given.clients, given.shards)),
        "full": lambda: interrupted("full", lambda x: full_disk(x, given.shards)),
    }
    results = {name: measurements[name]() for name in given.kinds or measurements}
    failed = [name for name, good in results.items() if not good]
    print(f"failed: {', '.join(failed)}" if failed else "all measurements pass")
    return len(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
