"""Write the source of the site as Markdown and pictures, from which any site generator can build it.

Run it from the folder of the project, before `mkdocs build`:  .venv/bin/python docs/notebook_pages.py

It writes to `build/site-source`:

- the pages of `docs`; links to `.ipynb` files lead to the pages of the notebooks;
- each `notebooks/NAME.ipynb` as a page with its text, tables and figures. The outputs are those of the last
  `docs/notebooks.py --check`, which executes the notebooks and writes them to `build/notebooks`. Without a check of the
  present text and code, the outputs stored in the notebook are shown;
- `gallery.md`, which shows every figure of the site. Each figure links to the code that draws it: a cell of a notebook,
  or a section of `figure_code.md`, which contains the functions that draw the figures of `docs/figures`.
"""

import ast
import base64
import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
import captions

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "notebooks"
CHECKED = ROOT / "build" / "notebooks"
DOCS, RENDERED = ROOT / "docs", ROOT / "build" / "site-source"

DRAWN_BY = {
    "tuning": "docs/pictures.py:tuning",
    "conventions": "docs/pictures.py:conventions",
    "trihedra": "docs/pictures.py:trihedra",
    "orientation": "docs/pictures.py:orientation",
    "turns": "docs/pictures.py:turns",
    "braking": "docs/pictures.py:braking",
    "by_speed": "docs/pictures.py:by_speed",
    "obstacles": "docs/pictures.py:obstacles",
    "zones": "docs/pictures.py:zones",
    "atlas": "docs/pictures.py:atlas",
    "work_precision": "benchmarks/accuracy/figures.py:work_precision_figure",
    "closed_loop_errors": "benchmarks/accuracy/figures.py:closed_loop_errors_figure",
    "recorded_gyro": "benchmarks/accuracy/figures.py:recorded_gyro_figure",
    "work_and_time": "benchmarks/figures.py:precision",
    "throughput": "benchmarks/figures.py:throughput",
}
"""The function that draws each figure of `docs/figures`."""

HEADING = re.compile(r"(?m)^(#+) (.+)$")


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


def contents() -> dict[str, str | bytes]:
    """The files that the step adds to the pages of `docs`, by their place."""
    pages = {file.stem: notebook_page(file.stem) for file in sorted(NOTEBOOKS.glob("*.ipynb"))}
    result: dict[str, str | bytes] = {f"notebooks/{name}.md": page.text for name, page in pages.items()}
    for name, page in pages.items():
        result |= {f"notebooks/{name}/figure_{figure.number}.png": figure.png for figure in page.figures}
    return result | {
        "notebooks/index.md": notebook_index(),
        "gallery.md": gallery(pages),
        "figure_code.md": figure_code(),
    }


def render(folder: Path) -> None:
    """Write the source of the site to a folder, which is replaced: the pages of `docs`, the notebooks, the gallery."""
    if folder.exists():
        shutil.rmtree(folder)
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    for page in folder.rglob("*.md"):
        page.write_text(page_links(page.read_text(encoding="utf-8")), encoding="utf-8")
    for place, content in contents().items():
        file = folder / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())


if __name__ == "__main__":
    render(RENDERED)
    sys.stdout.write(f"written to {RENDERED.relative_to(ROOT)}; now build the site: mkdocs build --strict\n")
