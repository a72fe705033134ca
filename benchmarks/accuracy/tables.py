"""Create Markdown tables, and insert them in a document between `<!-- name -->` and `<!-- end name -->`."""

import re


def table(header, rows):
    """Return a Markdown table; `text` formats the cells."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(text(cell) for cell in line) + " |" for line in lines)


def text(cell):
    """Format a float, for example as 1.2e-12 or with four digits as 1.234; convert other values with `str`."""
    if not isinstance(cell, float):
        return str(cell)
    if cell == 0:
        return "0"
    return f"{cell:.1e}" if abs(cell) < 1e-2 or abs(cell) >= 1e5 else f"{cell:.4g}"


def put(document, name, body):
    """Return the document with `body` between the markers of `name`.

    **Raises:** ValueError unless the document contains the markers exactly once.
    """
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    changed, count = pattern.subn(lambda match: f"{match[1]}\n{body}\n\n{match[2]}", document)
    if count != 1:
        raise ValueError(f"the document must contain the markers of {name!r} once, but contains them {count} times")
    return changed
