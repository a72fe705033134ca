"""A Griffe extension for the site: in docstrings, * and _ are symbols (μ*, λ̄_0, c*q), not emphasis."""

import re
from typing import Any

import griffe

CODE_OR_SYMBOL = re.compile(r"(``.*?``|`[^`]*`)|(?<!\*)\*(?!\*)|_", re.DOTALL)


class Symbols(griffe.Extension):
    """Escapes * and _ outside code; **bold** stays."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Escape the docstring of every loaded object."""
        if obj.docstring is not None:
            obj.docstring.value = CODE_OR_SYMBOL.sub(lambda m: m[1] or f"\\{m[0]}", obj.docstring.value)
