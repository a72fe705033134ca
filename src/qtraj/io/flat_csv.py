"""Write and read flat datasets as CSV: the header in comment lines, a row of column names, and exact numbers.

`pandas.read_csv(file, comment="#")` reads the table. With a pandas version before 3.1, add
`float_precision="round_trip"` for exact numbers.
"""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.foundation.untrusted import parse_json, read_text
from qtraj.io.flat import FORMAT, TEXT, Flat, kinds, require_header

MARK = "# "
TRUTH = {"True": True, "False": False}


def write_csv(flat: Flat, file: Path) -> None:
    """Write the header, the column names and the rows."""
    lines = [MARK + line for line in _written(flat.header)]
    lines.append(",".join(_quoted(name) for name in flat.columns))
    columns = [_texts(values) for values in flat.columns.values()]
    lines += map(",".join, zip(*columns, strict=True))
    file.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")


def read_csv(file: Path) -> Flat:
    """Read the columns and the header of a file.

    **Raises:** ValueError with the name of the file if the header is missing, or if a row does not match the header.
    """
    lines = read_text(file).split("\n")
    count = next((k for k, line in enumerate(lines) if not line.startswith(MARK)), len(lines))
    try:
        header = parse_json("".join(line.removeprefix(MARK) for line in lines[:count]) or "{}")
    except ValueError as error:
        raise ValueError(f"{file}: the header cannot be read ({error})") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ValueError(
            f"{file}: this CSV file has no dataset header. To use a recording, write a scenario: a .toml file with a "
            f'table [track] that contains file = "{file.name}", and a table [limits]. Then run `qtraj tune`. '
            "In Python, use qtraj.read_track for recordings and pandas for other tables."
        )
    try:
        names, *rows = list(csv.reader(io.StringIO("\n".join(lines[count:]), newline=""))) or [[]]
    except csv.Error as error:
        raise ValueError(f"{file}: the table cannot be read ({error})") from error
    if wrong := next((k for k, row in enumerate(rows, 1) if len(row) != len(names)), None):
        raise ValueError(f"{file}: row {wrong} has {len(rows[wrong - 1])} columns, but {len(names)} were expected")
    try:
        require_header(header)
        types = kinds(header)
        parts = zip(names, zip(*rows, strict=True), strict=True) if rows else ((name, ()) for name in names)
        return Flat({name: _parsed(texts, types[name]) for name, texts in parts}, header)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file}: the table does not match its header ({error})") from error


def _written(header: dict[str, Any]) -> list[str]:
    """Format the header as readable JSON with one line for each variable."""
    variables = header["variables"].items()
    lines = [f"{json.dumps(name)}: {json.dumps(about, ensure_ascii=False)}" for name, about in variables]
    first = {key: value for key, value in header.items() if key != "variables"}
    top = [f"{json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}," for key, value in first.items()]
    between = [f"  {line}," for line in lines[:-1]] + [f"  {line}" for line in lines[-1:]]
    return ["{", *top, '"variables": {', *between, "}}"]


def _texts(values: np.ndarray) -> list[str]:
    if values.dtype.kind == "U":
        return [_quoted(text) for text in values.tolist()]
    return list(map(repr, values.tolist()))


def _quoted(text: str) -> str:
    """Quote a string if it contains characters with a special meaning in CSV or in comments."""
    plain = all(c.isalnum() or c in "_-." for c in text) and text != ""
    return text if plain else '"' + text.replace('"', '""') + '"'


def _parsed(texts: Any, kind: str) -> np.ndarray:
    if kind == TEXT:
        return np.array(texts, dtype=str)
    if kind == "bool":
        return np.array([TRUTH[text] for text in texts], dtype=bool)
    return np.array([float(text) if kind.startswith("float") else int(text) for text in texts], dtype=kind)
