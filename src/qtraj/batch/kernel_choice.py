"""Choose between XLA and the fused kernel for GPUs.

The speed of the kernel has not been measured yet, so XLA is the default.
"""

import os
from typing import Any

VARIABLE = "QTRAJ_EVALUATE_KERNEL"
"""The environment variable that chooses the kernel."""

OFF, ON, INTERPRET = "off", "on", "interpret"

GPUS = ("gpu", "cuda", "rocm")


def kernel_choice() -> str:
    """Return "off" (the default), "on" (use the kernel on GPUs), or "interpret" (run it slowly on any device).

    **Raises:** ValueError for any other value of the environment variable.
    """
    found = os.environ.get(VARIABLE, "") or OFF
    if found not in (OFF, ON, INTERPRET):
        raise ValueError(f"{VARIABLE} must be {OFF!r}, {ON!r} or {INTERPRET!r}, but {found!r} was given")
    return found


def uses_kernel(choice: str, platform: Any) -> bool:
    """Return whether the kernel is used on a platform, such as "cpu" or "gpu"."""
    return choice == INTERPRET or (choice == ON and platform in GPUS)
