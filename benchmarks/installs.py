"""Install the wheel in fresh environments: seconds, size, and whether qtraj runs, for each extra, Python and jax.

    python -m benchmarks.installs
    python -m benchmarks.installs --python /usr/bin/python3.11 /usr/bin/python3.13 --extras all --jax 0.10 0.12

    python -m benchmarks.installs --extras all --types 0.9

Prints one row for each environment; the exit code is 1 if one fails. The wheel is built from the source distribution,
so that both are complete. With `--types`, pyright (extra `dev`) also reads the installed package as type checkers of
users do; the row fails if fewer symbols have known types. The seconds depend on the network and on the cache of pip.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

EXTRAS = ["", "cli", "io", "exchange", "viz", "all", "all,test"]

LIBRARY = (
    "import qtraj as qt; print(float(qt.trihedral(qt.SpiralHelix([10.0], [0.0, 1.0], [0.0, 0.5], 6.0), 3.0).curvature))"
)


def built(folder: Path) -> Path:
    """Build the source distribution, and from it the wheel; return the wheel."""
    run(sys.executable, "-m", "build", "--outdir", folder)
    [wheel] = folder.glob("*.whl")
    return wheel


def run(*command: str | Path) -> str:
    """Run a command in an empty folder, and return what it prints."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path.cwd() if "build" in command else folder
        done = subprocess.run([str(x) for x in command], capture_output=True, text=True, check=False, cwd=here)
    if done.returncode:
        raise RuntimeError((done.stderr or done.stdout).strip().splitlines()[-1][:200])
    return done.stdout


def size(folder: Path) -> int:
    """Return the size of the files in a folder [bytes]."""
    return sum(file.lstat().st_size for file in folder.rglob("*") if file.is_file() and not file.is_symlink())


def known_types(python: Path) -> float:
    """Return the fraction of public symbols whose types are known, in an environment."""
    pyright = Path(sys.executable).parent / "pyright"
    command = [str(pyright), "--verifytypes", "qtraj", "--ignoreexternal", "--outputjson"]
    found_first = os.environ | {"PATH": f"{python.parent}{os.pathsep}{os.environ['PATH']}"}  # not --pythonpath
    with tempfile.TemporaryDirectory() as folder:  # elsewhere, the source would be read instead of the package
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, env=found_first)
    return json.loads(done.stdout)["typeCompleteness"]["completenessScore"]


def row(python: str, wheel: Path, extra: str, jax: str, types: float) -> list[str]:
    """Install the wheel in a fresh environment, run qtraj, and return the cells of a row."""
    with tempfile.TemporaryDirectory() as folder:
        environment = Path(folder) / "environment"
        run(python, "-m", "venv", environment)
        own = environment / "bin" / "python"
        before, start = size(environment), time.perf_counter()
        pinned = [f"jax=={jax}.*", f"jaxlib=={jax}.*"] if jax else []
        run(own, "-m", "pip", "install", f"{wheel}[{extra}]" if extra else wheel, *pinned)
        seconds, installed = time.perf_counter() - start, size(environment) - before
        run(own, "-c", LIBRARY)
        if extra.startswith("all"):
            run(own, "-m", "qtraj", "tune", "--out", Path(folder) / "out")
        if types and (found := known_types(own)) < types:
            raise RuntimeError(f"the types of only {found:.1%} of the public symbols are known")
        names = "import sys, jax; print(sys.version.split()[0], jax.__version__)"
        version, jax_version = run(own, "-c", names).split()
    return [version, jax_version, extra or "none", f"{seconds:.0f} s", f"{installed / 1e6:.0f} MB", "runs"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", nargs="+", default=[sys.executable], metavar="FILE")
    parser.add_argument("--extras", nargs="+", default=EXTRAS, help="each is one extra, or several with commas")
    parser.add_argument("--jax", nargs="+", default=[""], metavar="VERSION", help="by default the newest allowed")
    parser.add_argument("--types", type=float, default=0.0, metavar="FRACTION", help="least fraction of known types")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wheel = built(Path(folder))
        print("| Python | jax | extra | installed in | size | |\n|---|---|---|---|---|---|")
        failed = False
        for python, jax, extra in product(given.python, given.jax, given.extras):
            try:
                cells = row(python, wheel, extra, jax, given.types)
            except RuntimeError as error:
                cells, failed = [python, jax or "newest", extra or "none", "", "", f"**{error}**"], True
            print(f"| {' | '.join(cells)} |", flush=True)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
