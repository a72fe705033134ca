"""Many instants of many paths in one call."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.batch.table import AXES, Table
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame, Natural

DEFAULT_OUTPUTS = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")


def evaluate(
    paths: AbstractHodograph,
    times: ArrayInput,
    outputs: Sequence[str] = DEFAULT_OUTPUTS,
    frame: AbstractFrame | None = None,
    components: str = "last",
    continuous: bool = False,
) -> Table:
    """Evaluate one path, or a stack of paths as `jax.vmap` makes it, at `times` (n,) [s].

    One path gives arrays (n, …), b paths (b, n, …); with `components="first"` the components' axes lead. `outputs`
    names fields of `Table`; `frame` is the trihedral to hang on the path (the natural one). A quaternion's sign is
    free at each instant; `continuous=True` chooses it so that neighbours in time agree.

    **Raises:** ValueError for something else than a path, unknown outputs, components other than "last" or "first", or
    times that are no vector.
    """
    if isinstance(outputs, str):
        raise ValueError(
            f"outputs must be a sequence of names, such as ({outputs!r},), but the text {outputs!r} was given"
        )
    if not isinstance(paths, AbstractHodograph):
        raise ValueError(
            f"a path, or many of them stacked into one, was expected, but a {type(paths).__name__} was given. "
            "Stack equal structures with jax.tree.map(lambda *x: jnp.stack(x), *paths), or build them under jax.vmap."
        )
    names = tuple(dict.fromkeys(outputs))
    if unknown := [name for name in names if name not in AXES]:
        raise ValueError(f"unknown output {unknown[0]!r}; known are {', '.join(AXES)}")
    if components not in ("last", "first"):
        raise ValueError(f"components must be 'last' or 'first', but {components!r} was given")
    instants = as_float(times)
    if instants.ndim != 1:
        raise ValueError(f"times must be a vector (n,), but an array of shape {instants.shape} was given")
    batched = jnp.ndim(paths.duration) == 1
    values = _evaluate(paths, instants, Natural() if frame is None else frame, names, batched, components, continuous)
    hung = "natural" if frame is None else type(frame).__name__.lower()
    return Table(time=instants, **values, batched=batched, components=components, frame=hung)


@eqx.filter_jit
def _evaluate(
    paths: AbstractHodograph,
    times: Float[Array, " n"],
    frame: AbstractFrame,
    names: tuple[str, ...],
    batched: bool,
    components: str,
    continuous: bool,
) -> dict[str, Array]:
    def along(path: AbstractHodograph) -> dict[str, Array]:
        values = jax.vmap(lambda t: _instant(path, t, frame, names))(times)
        if continuous and "quaternion" in values:
            values["quaternion"] = rotation.continuous(values["quaternion"])
        return values

    values = eqx.filter_vmap(along)(paths) if batched else along(paths)
    if components == "first":
        lead = 2 if batched else 1
        values = {name: jnp.moveaxis(v, range(lead), range(-lead, 0)) for name, v in values.items()}
    return values


def _instant(path: AbstractHodograph, t: Scalar, frame: AbstractFrame, names: tuple[str, ...]) -> dict[str, Array]:
    r = path.derivatives(t, 4)
    trihedral = frame.trihedral(r, as_float(path.duration))
    known = {
        "position": lambda: r[0],
        "velocity": lambda: r[1],
        "acceleration": lambda: r[2],
        "jerk": lambda: r[3],
        "dcm": trihedral.dcm,
        "quaternion": trihedral.quaternion,
        "gibbs": trihedral.gibbs,
        "speed": lambda: trihedral.speed,
        "curvature": lambda: trihedral.curvature,
        "torsion": lambda: trihedral.torsion,
        "rate": lambda: trihedral.rate,
        "angular_acceleration": lambda: trihedral.acceleration,
        "defined": lambda: trihedral.defined,
    }
    return {name: known[name]() for name in names}
