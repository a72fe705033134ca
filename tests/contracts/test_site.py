"""The source of the site: notebooks and a gallery as pages. MkDocs itself checks all links when it builds the site."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


site = load("notebook_pages")
NAMES = sorted(file.stem for file in (ROOT / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def pages():
    return {name: site.notebook_page(name) for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_one_title_and_every_figure(name, pages):
    page = pages[name]
    prose = re.sub(r"(?ms)^```.*?^```$", "", page.text)
    assert re.findall(r"(?m)^# (.+)$", prose) == [page.title]
    assert len(page.figures) >= 1
    for number, figure in enumerate(page.figures, 1):
        assert figure.png.startswith(b"\x89PNG")
        assert f'<a id="figure-{number}"></a>' in page.text
        assert f"({name}/figure_{number}.png)" in page.text


def test_code_and_what_it_prints_are_shown_without_magics(pages):
    text = pages["10_recorded_turn"].text
    assert "```python\nfrom importlib" in text
    assert re.search(r"```text\n[^`]*1/m", text)
    assert "%matplotlib" not in text


def test_the_gallery_shows_every_figure_and_links_to_its_code(pages):
    gallery, code = site.gallery(pages), site.figure_code()
    for file in (ROOT / "docs" / "figures").iterdir():
        assert f"](figures/{file.name})](figure_code.md#{file.stem}) " in gallery
        function = site.DRAWN_BY[file.stem].partition(":")[2]
        assert re.search(rf"## {file.stem} [^`]*`[^`]+`:\n\n```python\n[^`]*def {function}\(", code)
    for name, page in pages.items():
        for figure in page.figures:
            link = (
                rf"\]\(notebooks/{name}/figure_{figure.number}\.png\)\]\(notebooks/{name}\.md#figure-{figure.number}\)"
            )
            assert re.search(link, gallery)


def test_captions_are_sentences_and_belong_to_figures(pages):
    """No caption is left without a figure, and none is an instruction of a docstring."""
    captions = site.captions
    assert captions.PAGES.keys() == site.DRAWN_BY.keys()
    for name, written in captions.NOTEBOOKS.items():
        assert len(written) <= len(pages[name].figures)
    gallery = site.gallery(pages)
    for text in [*captions.PAGES.values(), *(text for written in captions.NOTEBOOKS.values() for text in written)]:
        assert text in gallery
        assert re.match(r"[A-Z].{20,150}\.$", text), text
        assert text.split()[0] not in ("Draw", "Plot", "Return")


def function(source, name="f"):
    """A function as the site's reader of docstrings sees it."""
    griffe = pytest.importorskip("griffe", reason="the extra docs is not installed")
    with griffe.temporary_visited_module(source) as module:
        return module[name]


LONG = '''
def f(a: int, b: float | None = None, *, c=1, d="x", e: bool = False):
    """Do something with `a`.

    `b` [m] is the width, by default 0.5. The depth `c` is optional; `d`: a name. A last sentence.
    """
'''


SHORT = '''
def f(a):
    """Do it.

    Args:
        a: The width [m],
            or None.

    Example:
        x
    """
'''


def test_a_function_with_many_parameters_has_a_table():
    pytest.importorskip("griffe", reason="tools of the site are in the extra docs")
    parameters = load("parameters")
    long = function(LONG)
    parameters.Parameters().on_function(func=long)
    lines = long.docstring.value.splitlines()
    assert lines[0] == "Do something with `a`."
    assert lines[2:4] == ["| parameter | type | default | meaning |", "|---|---|---|---|"]
    assert "| `b` | `float | None` | `None` | `b` [m] is the width, by default 0.5. |" in lines
    assert "| `c` |  | `1` | The depth `c` is optional |" in lines
    assert lines[-1].startswith("`b` [m] is the width")


def test_a_section_of_arguments_becomes_a_table_and_short_functions_stay():
    pytest.importorskip("griffe", reason="tools of the site are in the extra docs")
    parameters = load("parameters")
    short = function(SHORT)
    parameters.Parameters().on_function(func=short)
    assert "| `a` |  |  | The width [m], or None. |" in short.docstring.value
    assert "Args:" not in short.docstring.value
    assert "Example:" in short.docstring.value
    plain = function('def f(a, b):\n    """Do it with `a`."""')
    parameters.Parameters().on_function(func=plain)
    assert plain.docstring.value == "Do it with `a`."


def test_helpers_of_a_figure_are_shown_with_it():
    function, tree, _ = site._function("conventions")
    names = [node.name for node in site._with_helpers(function, tree)]
    assert {"conventions", "_passive", "_arrow"} <= set(names)
    assert "tuning" not in names


def test_links_to_notebooks_lead_to_their_pages():
    assert site.page_links("[a](../../notebooks/50_tuning.ipynb)") == "[a](../notebooks/50_tuning.md)"
    assert site.page_links("[a](../notebooks/50_tuning.ipynb#x)") == "[a](notebooks/50_tuning.md#x)"
    assert site.notebook_links("[a](50_tuning.ipynb), [b](../docs/errata.md)") == "[a](50_tuning.md), [b](../errata.md)"
    assert ".ipynb)" not in site.notebook_index()


def test_the_step_writes_all_pages_without_a_site_generator(tmp_path, pages):
    """And removes what an earlier run has left."""
    folder = tmp_path / "source"
    (folder / "old").mkdir(parents=True)
    site.render(folder)
    assert not (folder / "old").exists()
    written = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    expected = {str(f.relative_to(ROOT / "docs")) for f in (ROOT / "docs").rglob("*") if f.suffix in (".md", ".svg")}
    assert expected | {f"notebooks/{name}.md" for name in NAMES} <= written
    assert {"gallery.md", "figure_code.md", "notebooks/index.md", "site.css"} <= written
    assert not any(name.endswith((".py", ".pyc")) for name in written)
    figure = pages[NAMES[0]].figures[0]
    assert (folder / "notebooks" / NAMES[0] / "figure_1.png").read_bytes() == figure.png
    texts = {name: (folder / name).read_text(encoding="utf-8") for name in written if name.endswith(".md")}
    assert [name for name, text in texts.items() if ".ipynb)" in text] == []


def test_formulas_become_mathml():
    pytest.importorskip("latex2mathml", reason="the extra docs is not installed")
    inline, block = (
        load("formulas")
        .mathml(
            r'<p><span class="arithmatex">\(a &lt; b\)</span></p>' "\n" r'<div class="arithmatex">\[\frac12\]</div>'
        )
        .splitlines()
    )
    assert inline.startswith("<p><math")
    assert "&lt;" in inline or "&#x0003C;" in inline
    assert 'display="block"' in block
    assert "<mfrac>" in block


def test_every_notebook_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [name for name in NAMES if f"notebooks/{name}.md" not in navigation] == []
