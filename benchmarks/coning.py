"""Coning motions as test problems: ω(t), λ(t) in closed form, and the same problem for diffrax and SciPy."""

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import scipy.integrate

import qtraj as qt
from qtraj.motion.propagation.solver import AttitudeTerm


class Batch(NamedTuple):
    """Problems β [rad], Ω [rad/s] of (n,), over the same span [s]."""

    beta: np.ndarray
    omega: np.ndarray
    end: float

    def at(self, t):
        """λ (n, 4) in closed form."""
        half, phase = self.beta / 2, self.omega * t
        return np.stack([np.cos(half), np.sin(half) * np.cos(phase), np.sin(half) * np.sin(phase), 0 * half], axis=1)

    def error(self, qs):
        """The largest angle [rad] between `qs` (n, 4) and the final attitudes."""
        qs = np.asarray(qs) / np.linalg.norm(qs, axis=1, keepdims=True)
        last = self.at(self.end)
        gaps = [np.linalg.norm(qs + sign * last, axis=1) for sign in (1, -1)]
        return float(np.max(4 * np.arcsin(np.minimum(np.min(gaps, axis=0) / 2, 1.0))))


def rate(beta, omega, t):
    """ω(t) in body axes (3,)."""
    level, phase = omega * jnp.sin(beta), omega * t
    return jnp.stack([-level * jnp.sin(phase), level * jnp.cos(phase), -2 * omega * jnp.sin(beta / 2) ** 2 + 0 * t])


def each(batch: Batch, one: Callable):
    """`one`(ω, λ0) of all problems at once; without vmap for a single problem."""
    first = batch.at(0.0)
    if len(batch.beta) == 1:
        return one(functools.partial(rate, batch.beta[0], batch.omega[0]), jnp.asarray(first[0]))[None]
    return jax.vmap(lambda b, o, q: one(functools.partial(rate, b, o), q))(batch.beta, batch.omega, first)


def with_steps(batch: Batch, method):
    """steps → the final attitudes (n, 4) by `propagate` with this number of equal steps."""

    @functools.partial(jax.jit, static_argnums=0)
    def call(steps):
        times = np.array([0.0, batch.end])
        return each(batch, lambda omega, q: qt.propagate(omega, q, times, method, steps=steps)[-1])

    return call


def with_diffrax(batch: Batch, solver):
    """tolerance → the same by an adaptive solve; the tolerance is traced, so that one compilation serves all."""

    @jax.jit
    def call(tolerance):
        def one(omega, q):
            controller = diffrax.PIDController(rtol=tolerance, atol=tolerance)
            term = AttitudeTerm(omega)
            return diffrax.diffeqsolve(
                term, solver, 0.0, batch.end, None, q, stepsize_controller=controller, max_steps=None
            ).ys[0]

        return each(batch, one)

    return call


def with_equal_steps_of_diffrax(batch: Batch, solver):
    """steps → the same by a diffrax solver with equal steps: no controller, so all problems take the same steps."""

    @jax.jit
    def call(steps):
        def one(omega, q):
            return diffrax.diffeqsolve(
                AttitudeTerm(omega), solver, 0.0, batch.end, batch.end / steps, q, max_steps=None
            ).ys[0]

        return each(batch, one)

    return call


def with_scipy(batch: Batch, right_side: Callable | None = None):
    """tolerance → the same by successive `solve_ivp` with DOP853; `right_side` uses plain numbers by default."""

    make = in_plain_numbers if right_side is None else right_side
    problems = [(make(b, o), first) for b, o, first in zip(batch.beta, batch.omega, batch.at(0.0), strict=True)]

    def call(tolerance):
        span = (0.0, batch.end)
        runs = (
            scipy.integrate.solve_ivp(derivative, span, first, method="DOP853", rtol=tolerance, atol=tolerance)
            for derivative, first in problems
        )
        return np.stack([run.y[:, -1] for run in runs])

    return call


def in_arrays(beta, omega):
    """2λ̇ = λ∘ω, as commonly written with NumPy."""
    level, z = omega * np.sin(beta), -2 * omega * np.sin(beta / 2) ** 2

    def derivative(t, q):
        w = np.array([-level * np.sin(omega * t), level * np.cos(omega * t), z])
        return 0.5 * np.concatenate([[-q[1:] @ w], q[0] * w + np.cross(q[1:], w)])

    return derivative


def in_plain_numbers(beta, omega):
    """2λ̇ = λ∘ω with Python numbers, several times faster than arrays of four."""
    level, z = omega * math.sin(beta), -2 * omega * math.sin(beta / 2) ** 2

    def derivative(t, q):
        x, y = -level * math.sin(omega * t), level * math.cos(omega * t)
        s, a, b, c = q.tolist()
        return [
            0.5 * (-a * x - b * y - c * z),
            0.5 * (s * x + b * z - c * y),
            0.5 * (s * y + c * x - a * z),
            0.5 * (s * z + a * y - b * x),
        ]

    return derivative
