"""Show the results of tunings with margins, of `qtraj tune` and `qtraj route`."""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from qtraj.design.robust.box_outcome import BoxTuned
    from qtraj.design.robust.outcome import RobustTuned


def margins(robust: "RobustTuned | BoxTuned") -> dict[str, Any]:
    """Return the result of a tuning with margins as JSON types."""
    tightened = {name: float(np.asarray(x)) for name, x in robust.limits.given().items()}
    shares = {name: float(getattr(robust, name)) for name in ("share", "sampled_share") if hasattr(robust, name)}
    return {"result": robust.result, "tightened_limits": tightened, "tunings": int(robust.rounds), **shares}


def with_certificate(tuned: Any, certificate: Any) -> Any:
    """Return the result of a tuning within tightened limits, with the certificate of the specified limits."""
    import equinox as eqx

    return eqx.tree_at(lambda x: x.certificate, tuned, certificate)
