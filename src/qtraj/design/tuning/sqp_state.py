"""The state of the SQP searches of a batch."""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass
class State:
    """The state of a batch of searches: the current points, and the parameters of the next step."""

    z: Float[np.ndarray, "n batch"]
    cost: Float[np.ndarray, " batch"]
    largest: Float[np.ndarray, " batch"]  # the largest constraint value
    radius: Float[np.ndarray, " batch"]
    penalty: Float[np.ndarray, " batch"]
    size: Float[np.ndarray, " batch"]  # of the last accepted step
    rejected: Bool[np.ndarray, " batch"]  # the last step was rejected
    floor: Float[np.ndarray, " batch"]  # the penalty must not be lowered below this value
    lowered: Bool[np.ndarray, " batch"]  # the penalty was lowered more recently than raised
    least: Float[np.ndarray, " batch"]  # the lowest `largest` since the limits were last satisfied
    stalled: Int[np.ndarray, " batch"]  # number of steps without progress
    steps: Int[np.ndarray, " batch"]
    done: Bool[np.ndarray, " batch"]
    stationary: Bool[np.ndarray, " batch"]  # done at a stationary point

    @property
    def fields(self) -> list[np.ndarray]:
        """The arrays of the state."""
        return [getattr(self, f.name) for f in fields(self)]

    def take(self, index: np.ndarray) -> "State":
        """Return the states of some searches."""
        return State(*(x[..., index] for x in self.fields))

    def put(self, index: np.ndarray, other: "State") -> None:
        """Replace the states of some searches."""
        for f in fields(self):
            getattr(self, f.name)[..., index] = getattr(other, f.name)
