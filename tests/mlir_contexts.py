"""Lower many functions in one MLIR context: to create one takes as long as all other work for a small function."""

from jax._src.interpreters import mlir

REUSED = 256
"""Number of functions that are lowered in a context; its types and constants are freed with the context."""


class Contexts:
    """Makes contexts by JAX's own function, and returns each of them several times."""

    def __init__(self, make):
        self._make, self._context, self._count = make, None, 0

    def __call__(self):
        if self._context is None or self._count >= REUSED:
            self._context, self._count = self._make(), 0
        self._count += 1
        return self._context


def share_contexts() -> None:
    """Replace the function of JAX that makes a context for each lowering, if this version of JAX has it."""
    make = getattr(mlir, "make_ir_context", None)
    if make is not None and not isinstance(make, Contexts):
        mlir.make_ir_context = Contexts(make)
