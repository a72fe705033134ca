"""A hook of MkDocs (`hooks` in mkdocs.yml): formulas become MathML, so that a page needs no script."""

import html
import re
from typing import Any

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def mathml(page: str) -> str:
    """HTML with its formulas, which `pymdownx.arithmatex` has marked, as MathML."""
    from latex2mathml.converter import convert

    def formula(match: re.Match[str]) -> str:
        display = "block" if match[1] == "div" else "inline"
        return convert(" ".join(html.unescape(match[2]).split()), display=display)

    return FORMULA.sub(formula, page)


def on_page_content(html: str, **_: Any) -> str:
    """Formulas become MathML."""
    return mathml(html)
