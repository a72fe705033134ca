"""Compare gradients with central differences, as the tests do."""

from tests.motion import test_gradients as tests

from .guards import recorded
from .tables import table


def gradients():
    rows = []
    runs = {f"EulerTurn, {name}": (tests.test_euler_turn, end) for name, end in tests.ENDS.items()}
    runs |= {
        "propagate": (tests.test_propagate,),
        "integrate": (tests.test_integrate,),
        "simulate": (tests.test_simulate,),
    }
    for name, (test, *arguments) in runs.items():
        monitor = []
        with recorded(monitor):
            test(*arguments)
        # At each point, the tests compare the gradient first, and then the derivatives in two directions.
        reverse = max(part for _, part in monitor[0::3]) * tests.RELATIVE
        forward = max(part for k, (_, part) in enumerate(monitor) if k % 3) * tests.RELATIVE
        rows.append([name, reverse, forward, f"`{test.__name__}`"])
    return table(["through", "reverse mode − differences", "forward mode − differences", "checked by"], rows)
