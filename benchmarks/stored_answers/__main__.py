"""Create random problems, and store them with the answers of the qtraj that is imported.

    python -m benchmarks.stored_answers                         all groups, into tests/data/answers.npz
    python -m benchmarks.stored_answers tunings retimings.jerk  only groups whose names start so; others are kept

The file also contains the commit that HEAD names. So run this command before a change, and in a clean checkout.
"""

import argparse
import subprocess
import time
import zlib

import jax
import numpy as np

from . import FILE, GROUPS, stored

SEED = 34


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", help="beginnings of the names of groups; default: all")
    parser.add_argument("--commit", help="the commit to store; default: HEAD")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    commit = options.commit or _head()
    kept = stored()[1] if FILE.exists() else {}
    for name, group in GROUPS.items():
        if options.groups and not name.startswith(tuple(options.groups)):
            continue
        begun = time.process_time()
        given = group.make(np.random.default_rng([SEED, zlib.crc32(name.encode())]))
        answer = group.answer(given)
        kept[name] = {"given": given, "answer": answer}
        _save(commit, kept)
        counts = ", ".join(f"{key} {_counts(answer[key])}" for key in ("codes", "statuses") if key in answer)
        print(f"{name}: {time.process_time() - begun:.0f} s; {counts}", flush=True)
    print(f"{FILE}: {FILE.stat().st_size / 1e3:.0f} kB")


def _head():
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, cwd=FILE.parent, capture_output=True, text=True, check=True).stdout.strip()


def _save(commit, groups):
    ordered = {name: groups[name] for name in GROUPS if name in groups}
    arrays = {
        f"{name}.{part}.{field}": values.astype(np.float32) if field == "times" and part == "answer" else values
        for name, parts in ordered.items()
        for part, fields in parts.items()
        for field, values in fields.items()
    }
    np.savez_compressed(FILE, commit=np.array(commit), **arrays)


def _counts(codes):
    return dict(zip(*(x.tolist() for x in np.unique(codes, return_counts=True)), strict=True))


if __name__ == "__main__":
    main()
