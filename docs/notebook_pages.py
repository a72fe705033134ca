"""A hook of MkDocs (`hooks` in mkdocs.yml) that adds the notebooks and a gallery of all figures to the site.

- Each `notebooks/NAME.ipynb` becomes a page with its text, tables and figures. The outputs are those of the last
  `docs/notebooks.py --check`, which executes the notebooks and writes them to `build/notebooks`. Without a check of the
  present text and code, the outputs stored in the notebook are shown.
- `gallery.md` shows every figure of the site. Each figure links to the code that draws it: a cell of a notebook, or a
  section of `figure_code.md`, which contains the functions that draw the figures of `docs/figures`.
- Formulas between dollar signs become MathML, so that a page needs no script and fetches nothing.

The pages exist only while the site is built. Links to `.ipynb` files are redirected to these pages.
"""

import ast
import base64
import html
import json
import re
import sys
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
import captions

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "notebooks"
CHECKED = ROOT / "build" / "notebooks"

DRAWN_BY = {
    "tuning": "docs/pictures.py:tuning",
    "conventions": "docs/pictures.py:conventions",
    "trihedra": "docs/pictures.py:trihedra",
    "orientation": "docs/pictures.py:orientation",
    "turns": "docs/pictures.py:turns",
    "work_precision": "benchmarks/accuracy/figures.py:work_precision_figure",
    "closed_loop_errors": "benchmarks/accuracy/figures.py:closed_loop_errors_figure",
    "recorded_gyro": "benchmarks/accuracy/figures.py:recorded_gyro_figure",
    "work_and_time": "benchmarks/figures.py:precision",
    "throughput": "benchmarks/figures.py:throughput",
}
"""The function that draws each figure of `docs/figures`."""

HEADING = re.compile(r"(?m)^(#+) (.+)$")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


class NotebookFigure(NamedTuple):
    """A figure of a notebook: its number, the section it belongs to, and the PNG file."""

    number: int
    section: str
    png: bytes


class Page(NamedTuple):
    """A notebook as Markdown, with its figures."""

    title: str
    text: str
    figures: list[NotebookFigure]


def notebook_page(name: str) -> Page:
    """The page of `notebooks/NAME.ipynb`."""
    cells = _cells(name)
    prose = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    top_headings = [title for level, title in HEADING.findall(prose) if level == "#"]
    title = section = top_headings[0]
    deeper = "#" if len(top_headings) > 1 else ""  # a page has one heading of the first level
    parts: list[str] = []
    figures: list[NotebookFigure] = []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            section = (HEADING.findall(source) or [("", section)])[-1][1]
            source = HEADING.sub(lambda m: m[0] if m[2] == title else deeper + m[0], source)
            parts.append(notebook_links(source))
            continue
        outputs = [output.get("data", {"text/plain": output.get("text", "")}) for output in cell["outputs"]]
        if any("image/png" in data for data in outputs):
            parts.append(f'<a id="figure-{len(figures) + 1}"></a>')  # links lead to the code of the figure
        parts.append(_fence("python", re.sub(r"(?m)^%\w.*\n?", "", source)))
        for data in outputs:
            if "image/png" in data:
                figures.append(NotebookFigure(len(figures) + 1, section, base64.b64decode(data["image/png"])))
                n = len(figures)
                parts.append(f"![Figure {n}, {_plain(section)}]({name}/figure_{n}.png)")
            elif "text/html" in data:
                parts.append(re.sub(r"\n\s*\n", "\n", "".join(data["text/html"])))
            else:
                parts.append(_fence("text", "".join(data["text/plain"])))
    return Page(title, "\n\n".join(parts) + "\n", figures)


def notebook_index() -> str:
    """The page that lists the notebooks: their README."""
    return notebook_links((NOTEBOOKS / "README.md").read_text(encoding="utf-8"))


def notebook_links(text: str) -> str:
    """Links of the folder `notebooks`, as they are on the site."""
    return re.sub(r"\]\((\w+)\.ipynb\b", r"](\1.md", text).replace("](../docs/", "](../")


def page_links(text: str) -> str:
    """Links of a page of `docs` to notebooks, as they are on the site, where both are in one folder."""
    text = re.sub(r"\]\(((?:\.\./)*)\.\./notebooks/README\.md\b", r"](\1notebooks/index.md", text)
    return re.sub(r"\]\(((?:\.\./)*)\.\./notebooks/(\w+)\.ipynb\b", r"](\1notebooks/\2.md", text)


def _cells(name: str) -> list[dict[str, Any]]:
    """The cells of a notebook, with the outputs of its last check if its sources have not changed since."""
    stored, checked = (_stored_cells(folder / f"{name}.ipynb") for folder in (NOTEBOOKS, CHECKED))
    unchanged = [cell["source"] for cell in stored] == [cell["source"] for cell in checked]
    return checked if unchanged else stored


def _stored_cells(file: Path) -> list[dict[str, Any]]:
    return json.loads(file.read_text(encoding="utf-8"))["cells"] if file.exists() else []


def _fence(language: str, text: str) -> str:
    ticks = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    return f"{ticks}{language}\n{text.rstrip()}\n{ticks}"


def _plain(text: str) -> str:
    """A heading as the text of a picture or a link."""
    return re.sub(r"[`*$\[\]\\]", "", text)


def gallery(pages: dict[str, Page]) -> str:
    """The gallery: the figures of `docs/figures`, and those of each notebook."""
    parts = [
        "# Gallery",
        "The figures of this site. Click a figure to read the code that draws it.",
        "## Figures of the pages",
    ]
    shown = [f"- [![{name}](figures/{name}.svg)](figure_code.md#{name}) {captions.PAGES[name]}" for name in DRAWN_BY]
    parts.append(_grid(shown))
    for name, page in pages.items():
        parts.append(f"## Notebook: {page.title}")
        shown = []
        for n, section, _ in page.figures:
            picture = f"![Figure {n}](notebooks/{name}/figure_{n}.png)"
            shown.append(f"- [{picture}](notebooks/{name}.md#figure-{n}) {_caption(name, n, section)}")
        parts.append(_grid(shown))
    return "\n\n".join(parts) + "\n"


def _grid(items: list[str]) -> str:
    return '<div class="gallery" markdown>\n\n' + "\n".join(items) + "\n\n</div>"


def figure_code() -> str:
    """The page with the functions that draw the figures of `docs/figures`."""
    parts = ["# Code of the figures", "The functions that draw the figures of these pages, with their helpers."]
    for name, place in DRAWN_BY.items():
        function, tree, source = _function(name)
        file = place.partition(":")[0]
        sections = [ast.get_source_segment(source, node) or "" for node in _with_helpers(function, tree)]
        parts += [f"## {name} {{ #{name} }}", f"From `{file}`:", _fence("python", "\n\n\n".join(sections))]
    return "\n\n".join(parts) + "\n"


def _function(name: str) -> tuple[ast.FunctionDef, ast.Module, str]:
    """The function that draws a figure, its module and the text of that."""
    file, _, function = DRAWN_BY[name].partition(":")
    source = (ROOT / file).read_text(encoding="utf-8")
    tree = ast.parse(source)
    return _functions(tree)[function], tree, source


def _functions(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


def _with_helpers(function: ast.FunctionDef, tree: ast.Module) -> list[ast.FunctionDef]:
    """A function and the functions of its module that it uses, in the order of the module."""
    functions, used, pending = _functions(tree), set(), {function.name}
    while pending:
        used |= pending
        names = {n.id for f in pending for n in ast.walk(functions[f]) if isinstance(n, ast.Name)}
        pending = (names & functions.keys()) - used
    return [node for name, node in functions.items() if name in used]


def _caption(notebook: str, number: int, section: str) -> str:
    """The caption of a figure of a notebook, or its section if it has none."""
    written = captions.NOTEBOOKS.get(notebook, [])
    return written[number - 1] if number <= len(written) else section


def mathml(page: str) -> str:
    """HTML with its formulas, which `pymdownx.arithmatex` has marked, as MathML."""
    from latex2mathml.converter import convert

    def formula(match: re.Match[str]) -> str:
        display = "block" if match[1] == "div" else "inline"
        return convert(" ".join(html.unescape(match[2]).split()), display=display)

    return FORMULA.sub(formula, page)


def on_files(files: Any, *, config: Any) -> Any:
    """Add the pages and the figures of the notebooks, and the gallery."""
    from mkdocs.structure.files import File

    pages = {file.stem: notebook_page(file.stem) for file in sorted(NOTEBOOKS.glob("*.ipynb"))}
    contents: dict[str, str | bytes] = {f"notebooks/{name}.md": page.text for name, page in pages.items()}
    for name, page in pages.items():
        contents |= {f"notebooks/{name}/figure_{figure.number}.png": figure.png for figure in page.figures}
    contents |= {"notebooks/index.md": notebook_index(), "gallery.md": gallery(pages), "figure_code.md": figure_code()}
    for place, content in contents.items():
        files.append(File.generated(config, place, content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to notebooks lead to their pages."""
    return page_links(markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Formulas become MathML."""
    return mathml(html)
