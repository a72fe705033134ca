"""Classical coning: a motion with a closed form, used to compare attitude integrators."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import qtraj as qt
from qtraj.foundation.types import Scalar


class Coning(eqx.Module):
    """λ = (cos β/2, sin β/2 cos Ωt, sin β/2 sin Ωt, 0) and its rate; half-angle of the cone [rad], Ω [rad/s]."""

    angle: Scalar
    speed: Scalar

    def __init__(self, degrees, speed, dtype=None):
        self.angle = jnp.asarray(np.radians(degrees), dtype)
        self.speed = jnp.asarray(speed, dtype)

    def __call__(self, t):
        """ω in body axes."""
        level, phase = self.speed * jnp.sin(self.angle), self.speed * t
        vertical = -2 * self.speed * jnp.sin(self.angle / 2) ** 2
        return jnp.stack([-level * jnp.sin(phase), level * jnp.cos(phase), vertical * jnp.ones_like(t)])

    def rate(self, t):
        """ω in body axes, in NumPy."""
        beta, speed = float(self.angle), float(self.speed)
        level, phase, vertical = speed * np.sin(beta), speed * t, -2 * speed * np.sin(beta / 2) ** 2
        return np.array([-level * np.sin(phase), level * np.cos(phase), vertical])

    def quaternion(self, t):
        level, phase = jnp.sin(self.angle / 2), self.speed * t
        return jnp.stack([jnp.cos(self.angle / 2), level * jnp.cos(phase), level * jnp.sin(phase), jnp.zeros_like(t)])

    def inertial(self, t):
        """ω in inertial axes."""
        return qt.quaternion.rotate(self.quaternion(t), self(t))

    def quaternions(self, times):
        """λ at many times, in NumPy."""
        half, phase = float(self.angle) / 2, float(self.speed) * np.asarray(times, float)
        level = np.sin(half)
        parts = [np.full_like(phase, np.cos(half)), level * np.cos(phase), level * np.sin(phase), 0 * phase]
        return np.stack(parts, axis=1)

    def increments(self, times):
        """∫ω over the interval before each time, in closed form in NumPy; zero for the first."""
        beta, omega, t = float(self.angle), float(self.speed), np.asarray(times)
        drift = -2 * omega * np.sin(beta / 2) ** 2 * t
        total = np.stack([np.sin(beta) * np.cos(omega * t), np.sin(beta) * np.sin(omega * t), drift], axis=1)
        return np.diff(total, axis=0, prepend=total[:1])


SLOW = Coning(10.0, 0.74 * np.pi)
FAST = Coning(50.0, 2 * np.pi)


def angles(qs, expected):
    """Rotation [rad] between quaternions (n, 4) of any length and sign: expected⁻¹∘q, in NumPy."""
    (s, u), (t, v) = ((np.asarray(p)[:, 0], np.asarray(p)[:, 1:]) for p in (expected, qs))
    vector = s[:, None] * v - t[:, None] * u - np.cross(u, v)
    return 2 * np.arctan2(np.linalg.norm(vector, axis=1), np.abs(s * t + np.sum(u * v, axis=1)))
