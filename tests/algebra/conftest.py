"""Attitudes for the tests of conversions: random ones, and the singular ones."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

TINY_ANGLES = (1e-300, 1e-160, 1e-9, 1e-4)
NEAR_HALF_TURN = (1e-15, 1e-9, 1e-4)
AXES = [np.array(axis, dtype=float) for axis in itertools.product((-1, 0, 1), repeat=3) if any(axis)]


def _turn(axis, cosine, sine):
    return np.concatenate([[cosine], sine * axis / np.linalg.norm(axis)])


@pytest.fixture(scope="session")
def special():
    """Identity, half turns about 26 axes, rotations of the cube, tiny and nearly half turns; both signs."""
    turns = [np.array([1.0, 0, 0, 0])]
    for axis in AXES:
        turns.append(_turn(axis, 0.0, 1.0))
        turns += [_turn(axis, 1.0, angle / 2) for angle in TINY_ANGLES[:3]]
        turns += [_turn(axis, np.cos(TINY_ANGLES[3] / 2), np.sin(TINY_ANGLES[3] / 2))]
        turns += [_turn(axis, np.sin(gap / 2), np.cos(gap / 2)) for gap in NEAR_HALF_TURN]
    turns += list(Rotation.create_group("O").as_quat(scalar_first=True))
    qs = np.array(turns)
    return np.concatenate([qs, -qs])


@pytest.fixture(scope="session")
def attitudes(special):
    """10 000 random unit quaternions, then the special ones."""
    random = np.random.default_rng(2017).normal(size=(10_000, 4))
    return np.concatenate([random / np.linalg.norm(random, axis=1, keepdims=True), special])
