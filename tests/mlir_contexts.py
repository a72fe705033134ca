"""Lower many functions in one MLIR context: creating one takes as long as all other work for a small function."""

import threading

from jax._src.interpreters import mlir

REUSED = 256
"""Number of functions that are lowered in a context; its types and constants are freed with the context."""


class Contexts(threading.local):
    """Makes contexts by JAX's own function, and returns each of them several times, to one thread only."""

    def __init__(self, make):
        self.make, self.context, self.count = make, None, 0

    def __call__(self):
        if self.context is None or self.count >= REUSED:
            self.context, self.count = self.make(), 0
        self.count += 1
        return self.context


def share_contexts() -> None:
    """Replace the function of JAX that makes a context for each lowering, if this version of JAX has it."""
    make = getattr(mlir, "make_ir_context", None)
    if make is not None and not isinstance(make, Contexts):
        mlir.make_ir_context = Contexts(make)
