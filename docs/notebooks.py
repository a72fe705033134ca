"""Execute the notebooks, the scripts `notebooks/*.py`, and store each with its outputs as an `.ipynb` beside it.

Run it from the folder of the project:

    .venv/bin/python docs/notebooks.py              # all, or those named: 10_recorded_turn
    .venv/bin/python docs/notebooks.py --check      # execute, compare with the stored outputs, change no notebook
    .venv/bin/python docs/notebooks.py --prose      # store changed text, if no code has changed

Each notebook runs in its own Python process, on the CPU. As in Jupyter, the output of a cell is the printed text and
then the last expression. Text, HTML and figures are stored; stderr (warnings, and times, which differ between runs) is
not. No Jupyter kernel is needed. Outputs contain no times, no paths and no random names. The outputs of a check are
written to `build/notebooks`, from where a build of the site takes them.
"""

import argparse
import ast
import base64
import hashlib
import io
import json
import linecache
import os
import pprint
import re
import subprocess
import sys
import tempfile
import types
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "notebooks"
CHECKED = ROOT / "build" / "notebooks"
"""Where `--check` writes the notebooks it has executed."""

ENVIRONMENT = {"JAX_PLATFORMS": "cpu", "MPLBACKEND": "agg", "PYTHONHASHSEED": "0", "COLUMNS": "100"}
DPI, COLOURS = 120, 256

MARKER = re.compile(r"^# %%(?: \[(markdown)\])?$")
MAGIC = re.compile(r"(?m)^%\w.*$")
OTHERWISE_ELSEWHERE = re.compile(r"\b\d+\.\d+\.\d+[\w.]*|\b\d+(?: … \d+)?(?= steps)")
"""Versions, and numbers of search steps, which depend on rounding."""
NUMBER = re.compile(r"[-+−]?(?<![\w.])\d+\.?\d*(?:e[-+]?\d+)?", re.IGNORECASE)
RELATIVE, ABSOLUTE = 0.02, 1e-6
"""Tolerances of numbers between machines; values below 1e-6 count as rounding."""

DIGEST = "executed_sources_sha256"
METADATA = {
    "jupytext": {"formats": "ipynb,py:percent", "main_language": "python"},
    "kernelspec": {"display_name": "Python 3", "name": "python3"},
    "language_info": {"name": "python"},
}

Cell = tuple[str, str]
Output = dict[str, Any]


def cells(script: str) -> list[Cell]:
    """The cells of a percent script as (kind, source); magics of IPython are comments there."""
    _, *body = re.split(r"(?m)^(?=# %%)", script)
    result = []
    for block in body:
        marker, _, source = block.partition("\n")
        match = MARKER.match(marker)
        if match is None:
            raise ValueError(f"not a cell marker: {marker!r}; expected '# %%' or '# %% [markdown]'")
        source = source.strip("\n")
        if match[1]:
            result.append(("markdown", re.sub(r"(?m)^# ?", "", source)))
        else:
            result.append(("code", re.sub(r"(?m)^# (?=%\w)", "", source)))
    return result


def digest(of: list[Cell]) -> str:
    """A hash of the code of a notebook, without its prose, which changes no output."""
    return hashlib.sha256("\0".join(source for kind, source in of if kind == "code").encode()).hexdigest()


def notebook(of: list[Cell], outputs: list[list[Output]]) -> dict[str, Any]:
    """The `.ipynb` of these cells, with the outputs of each code cell."""
    result, seen = [], {}
    count = 0
    for kind, source in of:
        seen[source] = seen.get(source, 0) + 1
        name = hashlib.sha256(f"{seen[source]} {source}".encode()).hexdigest()[:8]
        cell: dict[str, Any] = {"cell_type": kind, "id": name, "metadata": {}, "source": source.splitlines(True)}
        if kind == "code":
            stored = outputs[count]
            count += 1
            cell |= {"execution_count": count, "outputs": [_numbered(output, count) for output in stored]}
        result.append(cell)
    metadata = METADATA | {"qtraj": {DIGEST: digest(of)}}
    return {"cells": result, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _numbered(output: Output, count: int) -> Output:
    return output | ({"execution_count": count} if output["output_type"] == "execute_result" else {})


def execute(name: str) -> list[list[Output]]:
    """The outputs of each code cell of a notebook, executed in this process."""
    module = types.ModuleType("__main__")
    sys.modules["__main__"] = module  # where classes of the notebook are looked up
    code = [source for kind, source in _cells(name) if kind == "code"]
    return [_outputs(source, f"<{name}, code cell {k}>", vars(module)) for k, source in enumerate(code, 1)]


def _outputs(source: str, label: str, namespace: dict[str, Any]) -> list[Output]:
    source = MAGIC.sub("", source)
    linecache.cache[label] = (len(source), None, source.splitlines(True), label)  # tracebacks show the lines
    tree = ast.parse(source, label)
    last = tree.body[-1] if tree.body else None
    value = None
    if isinstance(last, ast.Expr):
        tree.body.pop()
    with redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, label, "exec"), namespace)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), label, "eval"), namespace)
    outputs: list[Output] = []
    if text := printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": text.splitlines(True)})
    if value is not None:
        outputs.append({"data": shown(value), "metadata": {}, "output_type": "execute_result"})
    return outputs


def shown(value: Any) -> dict[str, Any]:
    """The display of a value in a notebook, by MIME type."""
    from matplotlib.figure import Figure

    plain = pprint.pformat(value, sort_dicts=False) if isinstance(value, dict | list | tuple) else repr(value)
    data: dict[str, Any] = {"text/plain": plain.splitlines(True)}
    if isinstance(value, Figure):
        data["image/png"] = base64.b64encode(picture(value)).decode()
    elif (html := getattr(value, "_repr_html_", None)) and not type(value).__module__.startswith("xarray"):
        data["text/html"] = html().splitlines(True)  # xarray's has random names
    return data


def picture(figure: Any) -> bytes:
    """A figure as a small PNG, without metadata."""
    from PIL import Image

    drawn, stored = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI, bbox_inches="tight", facecolor="white", metadata={"Software": None})
    image = Image.open(drawn).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(stored, format="png", optimize=True)
    return stored.getvalue()


def differences(stored: list[list[Output]], now: list[list[Output]]) -> list[str]:
    """Differences between outputs, except rounding, versions, steps of searches and the pixels of figures."""
    if len(stored) != len(now):
        return [f"{len(stored)} code cells are stored, but the script has {len(now)}"]
    result = []
    for k, (old, new) in enumerate(zip(stored, now, strict=True), 1):
        before, after = _text(old), _text(new)
        if not agree(before, after):
            result.append(f"code cell {k}: stored is\n{before}\nand now it is\n{after}")
    return result


def _text(outputs: list[Output]) -> str:
    """The compared parts of the outputs of a cell: their text, and the types of the rest."""
    parts = []
    for output in outputs:
        data = output.get("data", {})
        text = "".join(output.get("text", data.get("text/plain", [])))
        if text.startswith("<xarray.") or 'class="dataframe"' in "".join(data.get("text/html", [])):
            text = "a table in the layout of xarray or pandas"
        parts += [text, *sorted(data.keys() - {"text/plain"})]
    return "\n".join(parts)


def agree(before: str, after: str) -> bool:
    """Whether two texts are equal, with numbers up to rounding: 2 %, 1e-6, or one in the last decimal."""
    texts = [OTHERWISE_ELSEWHERE.sub("some", text) for text in (before, after)]
    if len({"".join(NUMBER.sub(" # ", text).split()) for text in texts}) > 1:
        return False
    return all(_close(a, b) for a, b in zip(*(NUMBER.findall(text) for text in texts), strict=True))


def _close(before: str, after: str) -> bool:
    a, b = (float(x.replace("−", "-")) for x in (before, after))
    return abs(a - b) <= max(RELATIVE * max(abs(a), abs(b)), ABSOLUTE, 1.001 * _last_digit(before))


def _last_digit(number: str) -> float:
    """The unit of the last decimal; zero for a whole number, which is exact."""
    mantissa, _, exponent = number.lower().partition("e")
    decimals = mantissa.partition(".")[2]
    return 10.0 ** (int(exponent or 0) - len(decimals)) if decimals else 0.0


def outputs_of(stored: dict[str, Any]) -> list[list[Output]]:
    """The outputs in an `.ipynb`, for each code cell."""
    return [cell["outputs"] for cell in stored["cells"] if cell["cell_type"] == "code"]


def _store(name: str) -> bool:
    outputs = _executed(name)
    if outputs is not None:
        _write(name, outputs, FOLDER)
    return outputs is not None


def _check(name: str, tolerant: bool = False) -> bool:
    outputs = _executed(name)
    if outputs is None:
        return False
    _write(name, outputs, CHECKED)
    faults = differences(outputs_of(_read(name)), outputs)
    for fault in faults:
        print(f"{name}: {fault}")
    if faults:
        print(f"{name}: if the change is intended, store it: python docs/notebooks.py {name}")
    return tolerant or not faults


def _store_prose(name: str) -> bool:
    stored = _read(name)
    if stored["metadata"].get("qtraj", {}).get(DIGEST) != digest(_cells(name)):
        print(f"{name}: its code has changed too, so execute it: python docs/notebooks.py {name}")
        return False
    _write(name, outputs_of(stored), FOLDER)
    return True


def _cells(name: str) -> list[Cell]:
    return cells((FOLDER / f"{name}.py").read_text(encoding="utf-8"))


def _read(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))


def _write(name: str, outputs: list[list[Output]], folder: Path) -> None:
    text = json.dumps(notebook(_cells(name), outputs), ensure_ascii=False, indent=1, sort_keys=True)  # as Jupyter does
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.ipynb").write_text(text + "\n", encoding="utf-8")


def _executed(name: str) -> list[list[Output]] | None:
    """The outputs of a notebook, executed in its own process; None if a cell fails."""
    print(f"{name}: executing", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "outputs.json"
        command = [sys.executable, __file__, "--execute-here", str(file), name]
        if subprocess.run(command, cwd=ROOT, env=os.environ | ENVIRONMENT).returncode:
            print(f"{name}: a cell failed")
            return None
        return json.loads(file.read_text(encoding="utf-8"))


def main() -> int:
    """Execute the named notebooks, or all."""
    parser = argparse.ArgumentParser(description="Execute the notebooks and store, or compare, their outputs.")
    parser.add_argument("names", nargs="*", help="notebooks without suffix; all by default")
    parser.add_argument("--prose", action="store_true", help="store changed prose without executing")
    parser.add_argument("--check", action="store_true", help="compare with the stored outputs and change no notebook")
    parser.add_argument("--warn", action="store_true", help="with --check: report differences, but exit with 0")
    parser.add_argument("--execute-here", metavar="FILE", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.execute_here:
        (name,) = arguments.names
        Path(arguments.execute_here).write_text(json.dumps(execute(name)), encoding="utf-8")
        return 0
    names = [Path(name).stem for name in arguments.names] or sorted(file.stem for file in FOLDER.glob("*.py"))
    work = partial(_check, tolerant=arguments.warn) if arguments.check else _store_prose if arguments.prose else _store
    results = [work(name) for name in names]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
