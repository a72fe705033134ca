"""Tables in Markdown, and their places in a document: `<!-- name -->` … `<!-- end name -->`."""

import re


def table(header, rows):
    """A Markdown table of texts; numbers have two digits."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(text(cell) for cell in line) + " |" for line in lines)


def text(cell):
    """1.2e-12 for a small float, otherwise a short decimal; other values unchanged."""
    if not isinstance(cell, float):
        return str(cell)
    if cell == 0:
        return "0"
    return f"{cell:.1e}" if abs(cell) < 1e-2 or abs(cell) >= 1e5 else f"{cell:.4g}"


def put(document, name, body):
    """The document with `body` between the markers of `name` (ValueError without them)."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    changed, count = pattern.subn(lambda match: f"{match[1]}\n{body}\n\n{match[2]}", document)
    if count != 1:
        raise ValueError(f"the document has {count} places for {name!r}, not one")
    return changed
