"""Define the scenario keys of a limit on a quantity of one's own, whose function is an expression."""

from collections.abc import Iterator

from qtraj.design.bound import bound_of
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.path.own_expression import ALLOWED
from qtraj.path.own_quantity import Quantity
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key
from qtraj.scenario.limit_forms import bound_in, kind_of_limit, valid_values


class OwnPart(Part):
    """A limit on a quantity of your own, which is computed from the motion by an expression.

    The expression is a formula, as of `qtraj.Quantity`, so the limit is proved: vectors in world axes, in metres and
    seconds.
    """

    name: keys.Text = key("the name", values="an identifier that no other quantity has")
    unit: keys.Text = key("the unit", values="a product of powers of m, s, kg, rad, N and W, such as 'm/s^2', or '1'")
    expression: keys.Text = key("the formula", values=f"a string such as 'velocity[2] / speed', with {ALLOWED}")
    limit: kind_of_limit(sides=True) = key(  # pyright: ignore[reportInvalidTypeForm]
        "the limit, in this unit", values=valid_values(sides=True)
    )
    meaning: keys.Text | None = key("a text for tables and figures; default: the name", None)

    def quantity(self) -> Quantity:
        """Return the quantity."""
        return Quantity(self.name, self.unit, self.expression, self.meaning or "")

    def _faults(self) -> Iterator[str]:
        try:
            name, bound = self.quantity().key, bound_in(self.model_dump()["limit"])
            if not isinstance(bound, LimitColumn):
                bound_of(bound, name)
        except ValueError as error:
            yield str(error)
