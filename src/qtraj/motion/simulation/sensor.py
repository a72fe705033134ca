"""Model the sensors of the on-board computer, which measure attitude and rate, or only the rate (gyros).

|λ| and ω0 are variables of the on-board computer, so sensor errors affect only the attitude and the physical rate. A
sensor may have a discrete state that changes at the samples.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PyTree, UInt32

from qtraj.algebra.quaternion import exp, product
from qtraj.foundation.arrays import as_float, concrete, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown, shown_html
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.simulation.actuator import Sampling, sampling_instants

Key = UInt32[Array, "2"]
Memory = PyTree[Array]
"""The discrete state of a sensor."""


class AbstractSensor(eqx.Module):
    """A sensor, which computes the measured state (the input of the law) from the true state.

    An own sensor is a subclass with a field `sampling` [s] (a period, instants, or None for a continuous sensor) and
    the methods `start` and `measure`. Noise needs sampling.
    """

    sampling: eqx.AbstractVar[Sampling | None]

    _repr_html_ = shown_html

    @abc.abstractmethod
    def start(self, quaternion: Quat, rate: Quat) -> Memory:
        """Return the discrete state of the sensor before the first sample, from the true initial state."""

    @abc.abstractmethod
    def measure(
        self, k: Int[Array, ""], elapsed: Scalar, quaternion: Quat, rate: Quat, memory: Memory
    ) -> tuple[Quat, Quat, Memory]:
        """Return the measured λ and ω (4,) of sample `k`, and the new discrete state of the sensor.

        `elapsed` [s] is the time from the previous sample; `quaternion`, `rate` are the true state.
        """


@storable
class Sensor(AbstractSensor):
    """A sensor of attitude and rate, each with a constant bias and white noise.

    `rate_bias` (3,) [rad/s], body axes. `rate_noise` [rad/s]: the standard deviation of the noise of each component.
    `attitude_bias` (3,) [rad]: the rotation vector from the true to the measured attitude, body axes. `attitude_noise`
    [rad]: the standard deviation of the noise added to each component of this vector. `key`: a key of `jax.random`,
    needed for noise. `sampling` [s]: a period or instants (see `Actuator`); each sample updates the command, which is
    held between the samples. With None, the sensor is continuous and cannot have noise, because continuous white noise
    does not have a finite variance.

    **Raises:** ValueError for noise without a key, a key without sampling, or negative noise.
    """

    rate_bias: Vec3
    rate_noise: Scalar
    attitude_bias: Vec3
    attitude_noise: Scalar
    sampling: Sampling | None
    key: Key | None

    def __init__(
        self,
        rate_bias: ArrayInput = (0.0, 0.0, 0.0),
        rate_noise: ArrayInput = 0.0,
        attitude_bias: ArrayInput = (0.0, 0.0, 0.0),
        attitude_noise: ArrayInput = 0.0,
        sampling: ArrayInput | None = None,
        key: ArrayInput | None = None,
    ):
        self.rate_bias, self.attitude_bias = _three(rate_bias, "rate_bias"), _three(attitude_bias, "attitude_bias")
        self.rate_noise, self.attitude_noise = _noise(rate_noise), _noise(attitude_noise)
        self.sampling = sampling_instants(sampling)
        self.key = _key(key)
        if self.key is None and (_noisy(self.rate_noise) or _noisy(self.attitude_noise)):
            raise ValueError("noise needs a key: pass key=jax.random.key(seed)")
        if self.key is not None and self.sampling is None:
            raise ValueError(
                "a key was given, but a sensor with noise must be sampled: pass sampling (a period or instants [s]), "
                "or omit key. A continuous sensor can only have a bias."
            )

    def __repr__(self) -> str:
        return shown(
            self, rate_bias="rad/s", rate_noise="rad/s", attitude_bias="rad", attitude_noise="rad", sampling="s"
        )

    def start(self, quaternion: Quat, rate: Quat) -> Memory:
        """Return None, because the sensor has no discrete state."""
        return None

    def measure(
        self, k: Int[Array, ""], elapsed: Scalar, quaternion: Quat, rate: Quat, memory: Memory
    ) -> tuple[Quat, Quat, Memory]:
        """Return the measured λ and ω (4,) of sample `k`, which are the true values with bias and noise."""
        dtype = quaternion.dtype
        rotation, rate_error = self.attitude_bias.astype(dtype), self.rate_bias.astype(dtype)
        if self.key is not None:
            noise = jax.random.normal(jax.random.fold_in(_wrapped(self.key), k), (2, 3), dtype)
            rotation = rotation + self.attitude_noise.astype(dtype) * noise[0]
            rate_error = rate_error + self.rate_noise.astype(dtype) * noise[1]
        return product(quaternion, exp(0.5 * rotation)), rate.at[1:].add(rate_error), memory


@storable
class Gyros(AbstractSensor):
    """Gyros without an attitude sensor: the on-board computer propagates λ from sampled rates (paper C, section 2).

    `sampling` [s]: a period or instants. `bias` (3,) [rad/s], body axes. `noise` [rad/s]: the standard deviation of the
    noise of each component. `key`: see `Sensor`. `attitude_error` (3,) [rad]: the rotation vector from the initial
    attitude to its estimate, body axes. The computer interpolates the rate linearly between samples. If the
    acceleration is constant between samples, this interpolation is exact. Only the error of the propagation then
    remains, which is O(h⁵) in each step of length h. See remark 1 of paper C.

    **Raises:** ValueError for noise without a key, or negative noise.
    """

    sampling: Sampling | None
    bias: Vec3
    noise: Scalar
    attitude_error: Vec3
    key: Key | None

    def __init__(
        self,
        sampling: ArrayInput,
        bias: ArrayInput = (0.0, 0.0, 0.0),
        noise: ArrayInput = 0.0,
        attitude_error: ArrayInput = (0.0, 0.0, 0.0),
        key: ArrayInput | None = None,
    ):
        instants = sampling_instants(sampling)
        if instants is None:
            raise ValueError("Gyros must be sampled, but sampling=None was given: pass a period [s]")
        self.sampling = instants
        self.bias, self.attitude_error = _three(bias, "bias"), _three(attitude_error, "attitude_error")
        self.noise = _noise(noise)
        self.key = _key(key)
        if self.key is None and _noisy(self.noise):
            raise ValueError("noise needs a key: pass key=jax.random.key(seed)")

    def __repr__(self) -> str:
        return shown(self, sampling="s", bias="rad/s", noise="rad/s", attitude_error="rad")

    def start(self, quaternion: Quat, rate: Quat) -> Memory:
        """Return the initial state of the on-board computer, its estimate of λ and the first gyro reading."""
        estimate = product(quaternion, exp(0.5 * self.attitude_error.astype(quaternion.dtype)))
        return estimate, self._gyro(jnp.asarray(0), rate)

    def measure(
        self, k: Int[Array, ""], elapsed: Scalar, quaternion: Quat, rate: Quat, memory: Memory
    ) -> tuple[Quat, Quat, Memory]:
        """Return the estimate of λ, the measured ω (4,), scalar part first, and the new state at sample `k`."""
        estimate, before = memory
        now = self._gyro(k, rate)
        estimate = propagate_linear_rate(estimate, before, now, elapsed)
        return estimate, now, (estimate, now)

    def _gyro(self, k: Int[Array, ""], rate: Quat) -> Quat:
        reading = rate.at[1:].add(self.bias.astype(rate.dtype))
        if self.key is None:
            return reading
        noise = jax.random.normal(jax.random.fold_in(_wrapped(self.key), k), (3,), rate.dtype)
        return reading.at[1:].add(self.noise.astype(rate.dtype) * noise)


def propagate_linear_rate(quaternion: Quat, before: Quat, now: Quat, elapsed: Scalar) -> Quat:
    """Return λ after `elapsed` [s], by a Magnus expansion of order 4.

    The body rate (4,) is linear in time, from `before` to `now`.
    """
    increment = 0.5 * elapsed * (before + now)
    vector = increment[1:] + elapsed * elapsed / 12 * jnp.cross(before[1:], now[1:])
    return jnp.exp(0.5 * increment[0]) * product(quaternion, exp(0.5 * vector))


def _three(x: ArrayInput, name: str) -> Vec3:
    vector = as_float(x)
    if vector.shape != (3,):
        raise ValueError(f"{name} must have shape (3,), but shape {vector.shape} was given")
    require_finite(vector, name)
    return vector


def _noise(x: ArrayInput) -> Scalar:
    x = as_float(x)
    value = concrete(x)
    if x.ndim or (value is not None and not value >= 0):
        raise ValueError(f"the standard deviation of noise must be a scalar and not negative, but {x} was given")
    return x


def _noisy(noise: Scalar) -> bool:
    value = concrete(noise)
    return value is None or bool(value > 0)


def _key(key: ArrayInput | jax.Array | None) -> Key | None:
    """Return the raw data of a key, two integers, because a typed key cannot be stored."""
    if key is None:
        return None
    if isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        return jax.random.key_data(key)
    return jnp.asarray(key, dtype=jnp.uint32)


def _wrapped(key: Key) -> jax.Array:
    return jax.random.wrap_key_data(key)
