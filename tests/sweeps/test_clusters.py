"""Sweeps on Dask: the same bytes as in one process, retries, lost schedulers, and scripts."""

import filecmp
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import qtraj as qt

distributed = pytest.importorskip("distributed")

TIMEOUT = 240
"""[s] Processes start slowly beside other work."""

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:(distributed|tornado|dask).*")


@pytest.fixture(scope="module")
def client():
    """A client of a cluster in this process."""
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as own:
        yield own


def same(first, second):
    """Whether two folders contain the same files with the same bytes."""
    files = [sorted(f.relative_to(x) for f in x.rglob("*") if f.is_file()) for x in (first, second)]
    return files[0] == files[1] and all(filecmp.cmp(first / f, second / f, shallow=False) for f in files[0])


def outputs(p):
    return {"y": p["a"] * p["x"], "v": np.stack([p["a"], p["x"]], 1)}


PARAMETERS = {"a": np.linspace(0.0, 1.0, 7), "x": qt.sweeps.Normal(0.0, 1.0)}
OPTIONS = {"samples": 9, "batch": True, "shard": 5}


def test_a_cluster_writes_the_same_bytes(tmp_path, client):
    here = qt.sweep(outputs, PARAMETERS, tmp_path / "here", workers=0, **OPTIONS)
    there = qt.sweep(outputs, PARAMETERS, tmp_path / "there", client=client, **OPTIONS)
    assert there.successful
    assert there.result == here.result
    assert same(tmp_path / "here", tmp_path / "there")


def test_a_shard_is_tried_again_and_its_error_reported(tmp_path, client):
    def fragile(p):
        first = p["a"][0]
        name = tmp_path / f"failed-{first:.0f}"
        again = name.exists()
        name.touch()
        if len(p["a"]) > 1 and (first == 4.0 or (first == 8.0 and not again)):
            raise RuntimeError("singular")
        return {"y": p["a"]}

    swept = qt.sweep(fragile, {"a": np.arange(12.0)}, tmp_path / "out", client=client, batch=True, shard=4, retries=2)
    assert swept.done == 8
    assert [str(error) for error in swept.errors] == ["points 4 to 7 (from a = 4): RuntimeError: singular"]


def test_other_outputs_are_not_tried_again(tmp_path, client):
    def late(p):
        with (tmp_path / "calls").open("a") as file:
            file.write("x")
        return {"z": 1.0} if p["a"] == 5.0 else {"y": 1.0}

    with pytest.raises(ValueError, match="the function returned 'z'"):
        qt.sweep(late, {"a": np.arange(8.0)}, tmp_path / "out", client=client, shard=4)
    assert len((tmp_path / "calls").read_text()) == 1 + 4 + 2


def test_a_lost_scheduler_is_an_error_and_the_next_run_completes(tmp_path, client):
    class Lost:
        """A client whose scheduler is lost after some tasks."""

        def __init__(self, given, after):
            self.given, self.after = given, after

        def nthreads(self):
            return {"one": 1}

        def submit(self, *arguments, **options):
            self.after -= 1
            future = self.given.submit(*arguments, **options)
            if self.after < 0:
                self.given.cancel([future], force=True)
            return future

        def cancel(self, futures):
            self.given.cancel(futures)

    with pytest.raises(ConnectionError, match="run the same sweep again"):
        qt.sweep(outputs, PARAMETERS, tmp_path / "out", client=Lost(client, 4), **OPTIONS)
    assert qt.sweep(outputs, PARAMETERS, tmp_path / "out", workers=0, **OPTIONS).successful
    qt.sweep(outputs, PARAMETERS, tmp_path / "whole", workers=0, **OPTIONS)
    assert same(tmp_path / "out", tmp_path / "whole")


def test_the_number_of_tasks_follows_the_threads_of_the_cluster(tmp_path, client):
    class Growing:
        """A client whose cluster has one thread at first, and then four."""

        def __init__(self):
            self.submitted, self.before = 0, []

        def nthreads(self):
            self.before.append(self.submitted)
            return {"one": 4 if self.submitted else 1}

        def submit(self, *arguments, **options):
            self.submitted += 1
            return client.submit(*arguments, **options)

        def cancel(self, futures):
            client.cancel(futures)

    growing = Growing()
    assert qt.sweep(outputs, PARAMETERS, tmp_path, client=growing, samples=9, batch=True, shard=3).successful
    assert growing.before[:4] == [0, 3, 13, 14]  # 3 for each thread, of which one has ended each time
    assert growing.submitted == 21


def run(script, folder):
    file = folder / "script.py"
    file.write_text(textwrap.dedent(script))
    return subprocess.run(
        [sys.executable, str(file)], capture_output=True, text=True, timeout=TIMEOUT, check=False, cwd=folder
    )


def test_a_script_uses_processes_with_float64(tmp_path):
    script = """
    import os
    import jax
    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import qtraj as qt

    def third(p):
        return {"y": jnp.asarray(p["a"]) / 3, "process": os.getpid()}

    if __name__ == "__main__":
        swept = qt.sweep(third, {"a": [1.0, 2.0, 3.0, 4.0]}, "out", workers=2, shard=1)
        dataset = swept.to_xarray()
        print(swept.result, dataset["y"].dtype, float(dataset["y"][0] - 1 / 3), os.getpid() in dataset["process"])
    """
    ended = run(script, tmp_path)
    assert ended.stdout == "4 of 4 points were computed, of which 0 failed. float64 0.0 False\n", ended.stderr


def test_a_script_without_a_main_guard_is_told_so(tmp_path):
    script = """
    import qtraj as qt

    def f(p):
        return {"y": p["a"]}

    qt.sweep(f, {"a": [1.0, 2.0]}, "out", workers=1)
    """
    ended = run(script, tmp_path)
    assert ended.returncode == 1
    assert "RuntimeError: the workers of a sweep could not start. If this is a script" in ended.stderr
    assert Path(tmp_path / "out").exists()


def test_workers_that_are_given_up_are_replaced(tmp_path):
    """A Dask cluster alone closes the supervisor of a worker that stays away, and then waits forever."""
    script = """
    from qtraj.sweeps import local_cluster

    if __name__ == "__main__":
        local_cluster.RESTARTS = 0.2
        with local_cluster.local_client(1) as client:
            client.cluster.sync(client.cluster.workers[0].close)
            del client.cluster.workers[0]
            print(client.submit(sum, [1, 2]).result(timeout=120))
    """
    ended = run(script, tmp_path)
    assert ended.stdout == "3\n", ended.stderr
