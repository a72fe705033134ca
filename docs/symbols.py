"""An extension of Griffe for the site: in docstrings, * and _ are symbols (μ*, λ̄_0, c*q), never emphasis."""

import re
from typing import Any

import griffe

CODE_OR_SYMBOL = re.compile(r"(``.*?``|`[^`]*`)|(?<!\*)\*(?!\*)|_", re.DOTALL)


class Symbols(griffe.Extension):
    """Escapes them, outside code; **bold** stays."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Of every object that is loaded."""
        if obj.docstring is not None:
            obj.docstring.value = CODE_OR_SYMBOL.sub(lambda m: m[1] or f"\\{m[0]}", obj.docstring.value)
