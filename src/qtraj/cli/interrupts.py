"""Repeat interrupts that Python would lose."""

import _thread
import sys
import threading
from typing import Any

DELAY = 0.05
"""Time [s] after which a lost interrupt is repeated."""


def keep_interrupts() -> None:
    """Repeat interrupts that Python ignores, because they occur in a callback such as JAX's for garbage collection."""
    report = sys.unraisablehook

    def repeat(unraisable: Any) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            timer = threading.Timer(DELAY, _thread.interrupt_main)  # after the callback
            timer.daemon = True
            timer.start()
        else:
            report(unraisable)

    sys.unraisablehook = repeat
