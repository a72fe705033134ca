"""Write the table of all path quantities into docs/howto/limits.md, from the registry.

Run it from the folder of the project:  .venv/bin/python docs/quantities.py
"""

import re
from pathlib import Path

from qtraj.path.path_quantity import INERTIA, PRINCIPAL, VEHICLE, WHEELBASE, PathQuantity
from qtraj.path.quantity import QUANTITIES, quantity
from qtraj.path.sides import has_sides, upper_side

PAGE = Path(__file__).parent / "howto" / "limits.md"
BEGIN = "<!-- begin of the table that docs/quantities.py writes -->"
END = "<!-- end of the table -->"
NEEDS = {
    "": "–",
    VEHICLE: "a vehicle",
    INERTIA: "its inertia",
    PRINCIPAL: "its principal inertia",
    WHEELBASE: "its wheelbase",
}
HEADER = "| limit | unit | meaning | sides | needs |\n|---|---|---|---|---|"


def page() -> str:
    """The page with the current table."""
    rows = "\n".join(_row(entry) for entry in QUANTITIES.values())
    text = PAGE.read_text(encoding="utf-8")
    return re.sub(f"{BEGIN}.*{END}", f"{BEGIN}\n\n{HEADER}\n{rows}\n\n{END}", text, flags=re.DOTALL)


def _row(entry: PathQuantity) -> str:
    signed = quantity(upper_side(entry))
    sides = "magnitude only" if not has_sides(entry) else "signed" if signed.signed else "never negative"
    meaning = signed.meaning.replace("|", "\\|")
    return f"| `{entry.name}` | {entry.label} | {meaning} | {sides} | {NEEDS[entry.needs]} |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
