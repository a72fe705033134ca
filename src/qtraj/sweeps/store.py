"""Define the store of a sweep: a Zarr group with one chunk of each array per shard, and a ledger of finished shards.

The chunks are not compressed, so that a worker writes them without a library and in a known size. The store contains
no times of day and no names of machines: the same sweep always writes the same bytes.

- `zarr.json`, `speed/zarr.json`, …: metadata of Zarr, format 3; `speed/c/12`: shard 12 of an output or a parameter.
- `.sweep/identity.json`: what the sweep computes; `.sweep/schema.json`: its outputs.
- `.sweep/ledger/12`: the entry of shard 12, written after its chunks; `.sweep/columns`: columns of parameters.
"""

import json
import shutil
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from qtraj.sweeps.durable import write_whole
from qtraj.sweeps.identity import Identity, require_same
from qtraj.sweeps.outputs import Output, Schema

ORDER = 1000
"""Number of ledger entries in one folder."""


@dataclass(frozen=True)
class Store:
    """A store in a folder, for `points` points in shards of `shard` points."""

    folder: Path
    points: int
    shard: int

    @property
    def own(self) -> Path:
        """The folder with all files that are not part of the Zarr group."""
        return self.folder / ".sweep"

    @property
    def columns(self) -> Path:
        """The folder with the columns of parameters."""
        return self.own / "columns"

    @property
    def shards(self) -> int:
        """The number of shards."""
        return -(-self.points // self.shard)

    def span(self, k: int) -> tuple[int, int]:
        """Return the first point of shard `k`, and the first point after it."""
        return k * self.shard, min((k + 1) * self.shard, self.points)

    def open(self, identity: Identity, arrays: Mapping[str, np.ndarray]) -> None:
        """Create the store, or check that it contains this sweep as far as `identity` tells; requires the lock.

        A new store belongs to no sweep until `claim`, so that nothing remains of a function that fails at once.

        **Raises:** ValueError if the folder contains something else; OSError if it is not writable.
        """
        if self._identity.exists():
            stored = read_json(self._identity)
            require_same(self.folder, {name: x for name, x in stored.items() if name in identity}, identity)
            self.clear_staging()
            return
        others = [x.name for x in self.folder.iterdir() if x.name != self.own.name]
        if others:
            raise ValueError(
                f"{self.folder}: this folder contains other files, such as {sorted(others)[0]}: pass a new folder"
            )
        self.clear_staging()
        shutil.rmtree(self.columns, ignore_errors=True)  # of a sweep that has failed
        for folder in (self.columns, self.own / "ledger"):
            folder.mkdir(exist_ok=True)
        for k, values in enumerate(arrays.values()):
            np.save(self._staging / "column.npy", values)
            write_whole(self.columns / f"{k}.npy", (self._staging / "column.npy").read_bytes(), self._staging)
        self.clear_staging()

    def claim(self, identity: Identity) -> None:
        """Let an open store belong to this sweep, or check that it does; requires the lock.

        **Raises:** ValueError if it belongs to another one.
        """
        if self._identity.exists():
            require_same(self.folder, read_json(self._identity), identity)
        else:
            self.write_json(self._identity, identity)

    def schema(self) -> Schema | None:
        """Return the outputs of the function, or None if they are not known yet."""
        file = self.own / "schema.json"
        if not file.exists():
            return None
        return {name: Output(dtype, tuple(shape)) for name, (dtype, shape) in read_json(file).items()}

    def write_schema(self, schema: Schema) -> None:
        """Store the outputs of the function; the metadata of all arrays must exist."""
        self.write_json(self.own / "schema.json", {name: [x.dtype, list(x.shape)] for name, x in schema.items()})

    def write_chunk(self, name: str, k: int, values: np.ndarray, fill: Any) -> int:
        """Write shard `k` of an array, and return its checksum; the last chunk is padded with `fill`."""
        if len(values) < self.shard:
            rest = np.full((self.shard - len(values), *values.shape[1:]), fill, values.dtype)
            values = np.concatenate([values, rest])
        plain: Any = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        content = memoryview(plain.view(np.uint8).reshape(-1))
        file = self._chunk(name, k, values.ndim)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, content, self._staging, flush=False)
        return zlib.crc32(content)

    def write_entry(self, k: int, entry: Mapping[str, Any]) -> None:
        """Add shard `k` to the ledger; all its chunks must exist."""
        file = self._entry(k)
        file.parent.mkdir(parents=True, exist_ok=True)
        self.write_json(file, entry)

    def entry(self, k: int, fingerprint: str) -> dict[str, Any] | None:
        """Return the entry of shard `k`, or None if it does not exist, is damaged, or has another fingerprint."""
        try:
            entry = json.loads(self._entry(k).read_bytes())
        except (FileNotFoundError, ValueError):
            return None
        return entry if _is_entry(entry) and entry["fingerprint"] == fingerprint else None

    def entries(self, fingerprint: str) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield the numbers and the entries of all finished shards, in order."""
        for k in range(self.shards):
            if (entry := self.entry(k, fingerprint)) is not None:
                yield k, entry

    def is_complete(self, k: int, checksums: Mapping[str, int], arrays: Mapping[str, Output]) -> bool:
        """Return whether the chunks of a finished shard have their checksums.

        Chunks are not flushed to the disk, which would take longer than many computations, so a power failure may
        destroy chunks whose entry exists.
        """
        for name, output in arrays.items():
            file = self._chunk(name, k, 1 + len(output.shape))
            if not file.exists() or zlib.crc32(file.read_bytes()) != checksums.get(name):
                return False
        return True

    def read_chunk(self, name: str, k: int, output: Output) -> np.ndarray:
        """Return shard `k` of an array, without its padding."""
        start, stop = self.span(k)
        content = self._chunk(name, k, 1 + len(output.shape)).read_bytes()
        return np.frombuffer(content, output.dtype).reshape(self.shard, *output.shape)[: stop - start]

    def write_json(self, file: Path, content: Mapping[str, Any]) -> None:
        """Write a JSON file, and flush it to the disk."""
        write_whole(file, json.dumps(content, indent=1).encode(), self._staging)

    @property
    def _identity(self) -> Path:
        return self.own / "identity.json"

    @property
    def _staging(self) -> Path:
        return self.own / "staging"

    def clear_staging(self) -> None:
        """Remove unfinished files of killed processes; requires the lock."""
        shutil.rmtree(self._staging, ignore_errors=True)
        self._staging.mkdir(parents=True, exist_ok=True)

    def _entry(self, k: int) -> Path:
        return self.own / "ledger" / str(k // ORDER) / str(k)

    def _chunk(self, name: str, k: int, dimensions: int) -> Path:
        return self.folder.joinpath(name, "c", str(k), *("0",) * (dimensions - 1))


def read_json(file: Path) -> dict[str, Any]:
    """Return the content of a JSON file of a store.

    **Raises:** ValueError with the name of the file if it is damaged.
    """
    try:
        content = json.loads(file.read_bytes())
        if not isinstance(content, dict):
            raise ValueError("an object was expected")
    except ValueError as error:
        raise ValueError(f"{file}: this file of a sweep is damaged ({error}); remove the folder") from None
    return content


_ENTRY = {"fingerprint": str, "points": int, "failed": int, "texts": list, "checksums": dict, "summary": dict}
"""The keys of an entry of the ledger, and the types of their values."""


def _is_entry(content: Any) -> bool:
    """Return whether a JSON value is an entry of the ledger."""
    return isinstance(content, dict) and all(isinstance(content.get(key), kind) for key, kind in _ENTRY.items())
