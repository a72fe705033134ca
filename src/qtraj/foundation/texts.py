"""Provide the messages of a batch as a sequence of strings."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, overload

import numpy as np


class Texts(Sequence[str]):
    """Messages of the elements of a batch, composed on access, and indexed like an array with the batch axes."""

    def __init__(self, make: Callable[[tuple[int, ...]], str], shape: tuple[int, ...]):
        self._make, self._shape = make, shape
        self._at = np.arange(np.prod(shape, dtype=int)).reshape(shape)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> "Texts": ...
    def __getitem__(self, index: Any) -> Any:
        at = self._at[index]
        if np.ndim(at) == 0:
            return self._make(tuple(int(k) for k in np.unravel_index(at, self._shape)))
        part = Texts(self._make, self._shape)
        part._at = at
        return part

    def __len__(self) -> int:
        return len(self._at)

    def __iter__(self) -> Iterator[Any]:
        return (self[k] for k in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        texts = [self._make(tuple(map(int, np.unravel_index(k, self._shape)))) for k in self._at.ravel()]
        return np.array(texts, dtype=dtype or str).reshape(self._at.shape)

    def __repr__(self) -> str:
        return f"<texts of {' × '.join(map(str, self._at.shape))} results>"
