"""Paths shared by the tests of this package."""

import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt


def states(seed: int = 0, rate: float = 0.4) -> tuple[qt.BoundaryState, qt.BoundaryState]:
    """Two states about the z axis whose V_φ/ρ agree."""
    rng = np.random.default_rng(seed)
    result = []
    for azimuth in (rng.uniform(-3, 3), rng.uniform(-3, 3)):
        radius, across, climb = rng.uniform(10, 40), *rng.uniform(-2, 2, size=2)
        along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        around = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        position = radius * along + [0, 0, rng.uniform(-5, 5)]
        result.append(qt.BoundaryState(position, across * along + rate * radius * around + [0, 0, climb]))
    return result[0], result[1]


@pytest.fixture
def helix() -> qt.SpiralHelix:
    """A right-angle climbing turn."""
    return qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35], [1.0, 0.4, 0.05, -0.01], 4.5)


@pytest.fixture
def tilted() -> qt.SpiralHelix:
    """Polynomial angle of degree 3 and a quintic radius, on a tilted axis away from the origin."""
    placement = qt.Placement([100.0, -40.0, 7.0], [2.0, 0.3, -0.5, 0.1])
    return qt.SpiralHelix([15.0, 2.0, 0.1, 0.02, -0.01, 0.001], [1.0, 0.5, 0.05, -0.01], [0.0, 1.0], 3.0, placement)


def as_curve(path: qt.SpiralHelix) -> qt.Curve:
    """The same curve computed from its definition, without the rotating basis."""

    def position(t):
        powers = lambda c: sum(c[k] * t**k for k in range(c.shape[0]))  # noqa: E731
        rho, phi, h = powers(path.radius), powers(path.angle), powers(path.height)
        local = jnp.stack([rho * jnp.cos(phi), rho * jnp.sin(phi), h])
        if path.placement is None:
            return local
        return path.placement.origin + path.placement.to_world(local)

    return qt.Curve(position, path.duration)
