"""Former names of the control package warn and work until 1.0."""

import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.motion import control

from ..rigs import Rest

LAW = control.AccelerationLaw(2.0, 1.0)
MU, RATE_ERROR = jnp.asarray([0.8, 0.36, 0.48, 0.0]), jnp.asarray([0.2, -0.1, 0.3])


def test_former_names_warn_and_work():
    expected = control.place(LAW, Rest()(0.0), MU, RATE_ERROR, normalization="gibbs")
    with pytest.warns(DeprecationWarning, match=r"'(gauge|excess)' of place\(\) is now called"):
        result = control.place(LAW, Rest()(0.0), MU, excess=RATE_ERROR, gauge="gibbs")
    np.testing.assert_array_equal(result[0], expected[0])
    with pytest.raises(TypeError, match="both 'normalization' and its former name 'gauge'"):
        control.place(LAW, Rest()(0.0), MU, RATE_ERROR, gauge="gibbs", normalization="gibbs")
    for old, new in {"growth": "spectral_abscissa", "gibbs_gauge": "gibbs_normalization"}.items():
        with pytest.warns(DeprecationWarning, match=f"control.{old} is now called qtraj.control.{new}"):
            assert getattr(control, old) is getattr(control, new)
