"""Describe what a sweep computes, so that a store is only completed by the sweep that started it."""

import json
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from qtraj._version import __version__
from qtraj.sweeps.digests import digest, name_of

Identity = dict[str, str]
"""The parts of the description by name; their values are texts or digests."""

LONGEST = 100
"""Maximum number of characters of each value in the message about a difference."""

ADVICE = "pass another folder, or remove this one to compute it anew"


def identity(
    function: Callable[..., Any],
    parameters: Mapping[str, Any],
    settings: Mapping[str, Any],
) -> Identity:
    """Return the identity of a sweep: its function, parameters, seed, dtype, versions and settings.

    `settings` are further values on which the store depends, by name.
    """
    own = {f"the parameter '{name}'": digest(value) for name, value in parameters.items()}
    return {
        "the name of the function": name_of(function),
        "the function": digest(function),
        "the order of the parameters": ", ".join(parameters),
        **own,
        "the default dtype": "float64" if jax.config.read("jax_enable_x64") else "float32",
        "the version of qtraj": __version__,
        "the version of Python": ".".join(platform.python_version_tuple()[:2]),
        "the version of JAX": jax.__version__,
        "the version of NumPy": np.__version__,
        **{name: str(value) for name, value in settings.items()},
    }


def require_same(folder: Path, stored: Identity, own: Identity) -> None:
    """Raise a ValueError that names the first difference between the identity of a store and of a sweep."""
    for name in (*own, *stored):
        there, here = stored.get(name), own.get(name)
        if there != here:
            changed = f"{name} differs ({_short(there)} there, {_short(here)} now)"
            raise ValueError(f"{folder}: this folder contains another sweep, because {changed}: {ADVICE}")


def _short(text: object) -> str:
    """Return the start of a long text."""
    whole = str(text)
    return whole if len(whole) <= LONGEST else f"{whole[:LONGEST]} …"


def fingerprint(own: Identity) -> str:
    """Return one digest of an identity, which each entry of the ledger contains."""
    return digest(json.dumps(own, sort_keys=True))
