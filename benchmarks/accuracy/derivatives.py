"""Gradients compared with central differences, as in the tests."""

from tests.motion import test_gradients as tests

from .guards import recorded
from .tables import table


def gradients():
    rows = []
    runs = {f"EulerTurn, {name}": (tests.test_euler_turn, end) for name, end in tests.TURNS.items()}
    runs |= {
        "propagate": (tests.test_propagate,),
        "integrate": (tests.test_integrate,),
        "simulate": (tests.test_simulate,),
    }
    for name, (test, *arguments) in runs.items():
        monitor = []
        with recorded(monitor):
            test(*arguments)
        differences = max(part for _, part in monitor[0::2]) * tests.RELATIVE
        modes = max(part for _, part in monitor[1::2]) * tests.AGREEMENT
        rows.append([name, differences, modes, f"`{test.__name__}`"])
    return table(["through", "reverse mode − differences", "forward − reverse", "guarded by"], rows)
