"""Workers and clients that are killed at random: the store is the same as without, and nothing is computed twice."""

import filecmp
import os
import random
import signal
import subprocess
import sys
import textwrap
import time

import pytest

pytest.importorskip("distributed")

SEED, SHARDS, WORKER_KILLS, CLIENT_KILLS = 3, 40, 6, 2
LONGEST = 25
"""[s] After this time nothing more is killed, so that the test ends on a busy machine, too."""

SCRIPT = """
import os, sys, time
from pathlib import Path
import numpy as np
import qtraj as qt

FOLDER = Path(__file__).parent

def slow(points):
    if len(points["a"]) > 1:
        shard = int(points["a"][0])
        finished = (FOLDER / sys.argv[1] / ".sweep/ledger/0" / str(shard)).exists() if len(sys.argv) > 1 else False
        with (FOLDER / "calls").open("a") as file:
            file.write(f"{os.getpid()} {shard} {int(finished)}\\n")
        time.sleep(0.1)
    return {"y": np.sin(points["a"]) * points["x"], "v": np.stack([points["x"]] * 3, 1)}

slow.batch = True

if __name__ == "__main__":
    parameters = {"a": np.arange(%d), "x": qt.sweeps.Normal(0.0, 1.0)}
    swept = qt.sweep(slow, parameters, FOLDER / sys.argv[1], samples=50, shard=50, workers=int(sys.argv[2]), retries=20)
    print(swept.result)
"""


def calls(folder):
    """The process, the shard, and whether the shard was finished, of each call so far."""
    file = folder / "calls"
    lines = file.read_text().splitlines() if file.exists() else []
    return [tuple(map(int, line.split())) for line in lines if line.count(" ") == 2]


@pytest.mark.slow
def test_killed_workers_and_clients(tmp_path):
    (tmp_path / "script.py").write_text(textwrap.dedent(SCRIPT % SHARDS))
    command = [sys.executable, str(tmp_path / "script.py")]
    pick, began, killed = random.Random(SEED), time.monotonic(), []

    def kill_worker():
        seen = calls(tmp_path)
        if seen and seen[-1][0] not in killed:
            killed.append(seen[-1][0])
            os.kill(seen[-1][0], signal.SIGKILL)

    for run in range(CLIENT_KILLS + 1):
        client = subprocess.Popen([*command, "killed", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        before, enough = len(calls(tmp_path)), pick.randint(5, 15)
        while client.poll() is None:
            time.sleep(pick.uniform(0.2, 0.6))
            if time.monotonic() - began > LONGEST:
                continue
            if run < CLIENT_KILLS and len(calls(tmp_path)) > before + enough:
                client.kill()
            elif len(killed) < WORKER_KILLS:
                kill_worker()
        output, error = client.communicate()
    assert output == f"{50 * SHARDS} of {50 * SHARDS} points were computed, of which 0 failed.\n", error
    made = calls(tmp_path)
    assert not any(finished for _, _, finished in made)
    assert {shard for _, shard, _ in made} == {*range(SHARDS)}
    assert len(killed) >= 1
    subprocess.run([*command, "whole", "0"], check=True, capture_output=True, timeout=240)
    whole, folder = tmp_path / "whole", tmp_path / "killed"
    files = [sorted(f.relative_to(x) for f in x.rglob("*") if f.is_file()) for x in (whole, folder)]
    assert files[0] == files[1]
    assert all(filecmp.cmp(whole / f, folder / f, shallow=False) for f in files[0])
