"""Create random tuning problems: turns of 0.6 to 3 rad between radii of 10 to 40 m, with feasible curvature limits.

Each limit is between the peak of the initial path and the smallest peak that SLSQP finds from this path.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt
from benchmarks.tuning.slsqp import least_peaks
from qtraj.design.tuning.motions.uniform import Uniform
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.problem import Problem, pose

SPEED = 8.0
SCATTER = np.array([1.5, 0.5, 1.5, 0.5])  # standard deviation [m/s] of V_rho and V_h at both ends
SHARE = (0.05, 0.95)  # range of limits, as a fraction from the smallest to the initial peak


class Problems(NamedTuple):
    """Batches of boundary states and limits, and the same problems in the form that the solvers need."""

    starts: qt.BoundaryState
    ends: qt.BoundaryState
    limits: np.ndarray  # [1/m]
    least: np.ndarray  # [1/m] the smallest reachable peak curvature
    posed: Problem


def problems(count: int, seed: int) -> Problems:
    """Return `count` random problems, reproducible by `seed`."""
    rng = np.random.default_rng(seed)
    radii, turns = rng.uniform(10, 40, (count, 2)), rng.uniform(0.6, 3.0, count)
    heights, velocities = rng.uniform(-2, 2, count), rng.normal(size=(count, 4)) * SCATTER
    shares = rng.uniform(*SHARE, count)
    rates = SPEED / np.sqrt(radii[:, 0] * radii[:, 1])
    starts, ends = jax.vmap(_states)(*map(jnp.asarray, (radii, turns, heights, velocities, rates)))
    posed = jax.vmap(lambda a, b: pose(a, b, Nearest(), Uniform(), None, 0, None))(starts, ends)
    nominal = jax.jit(jax.vmap(lambda p: qt.peak(p.path(jnp.zeros(p.size)), "curvature")[1]))(posed)
    nominal = np.asarray(nominal)
    least = np.minimum(least_peaks(posed, nominal), nominal)
    return Problems(starts, ends, least + shares * (nominal - least), least, posed)


def _states(
    radii: jax.Array, turn: jax.Array, height: jax.Array, velocity: jax.Array, rate: jax.Array
) -> tuple[qt.BoundaryState, qt.BoundaryState]:
    """Return a start on the x axis and an end after the turn; velocities are from cylindrical components."""
    zero, one = jnp.zeros_like(turn), jnp.ones_like(turn)
    out = jnp.stack([jnp.cos(turn), jnp.sin(turn), zero])
    along = jnp.stack([-jnp.sin(turn), jnp.cos(turn), zero])
    up = jnp.stack([zero, zero, one])
    first = jnp.stack([velocity[0], rate * radii[0], velocity[1]])
    last = velocity[2] * out + rate * radii[1] * along + velocity[3] * up
    start = qt.BoundaryState(jnp.stack([radii[0], zero, zero]), first)
    return start, qt.BoundaryState(radii[1] * out + height * up, last)
