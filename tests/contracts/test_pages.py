"""Runs the code blocks of the README and of the pages of docs/.

The blocks of a page run in order, in one namespace and one folder:

- Python runs; a `text` block right after it is the expected output ("..." matches anything).
- A block with a title (```` ```toml title="turn.toml" ````) is written to that file.
- `qtraj` in a shell block runs in this process and must exit with 0. For other commands the files, folders and modules
  that they name must exist; an unknown command is a failure.
"""

import contextlib
import doctest
import importlib.util
import io
import re
import runpy
import shlex
from pathlib import Path
from typing import NamedTuple

import jax
import pytest
from typer.testing import CliRunner

from qtraj.cli.main import application

ROOT = Path(__file__).parents[2]
PAGES = {str(file.relative_to(ROOT)): file for file in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))}

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it", "each_picture_is_drawn_once")

FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", flags=re.S | re.M)
TITLE = re.compile(r'title="([^"]+)"')
LIKE = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
WITHOUT_EFFECT = {"--install-completion"}
"""Options that change the user's own files; the test only checks that they exist."""


class Block(NamedTuple):
    """A fenced block: its language, the rest of that line, its text, and its first line."""

    language: str
    info: str
    text: str
    line: int
    follows: bool
    """Whether only blank lines separate it from the previous block."""


def blocks(page):
    """The fenced blocks of a page."""
    result, end = [], None
    for match in FENCE.finditer(page):
        language, _, info = match[1].partition(" ")
        follows = end is not None and not page[end : match.start()].strip()
        result.append(Block(language, info, match[2], page.count("\n", 0, match.start()) + 1, follows))
        end = match.end()
    return result


def run(text, folder):
    """Run the blocks of a page in a folder with the project's examples, and return how many ran."""
    count, namespace, printed = 0, {"__name__": "page"}, None
    (folder / "examples").symlink_to(ROOT / "examples")
    for block in blocks(text):
        if block.language == "python":
            code = compile("\n" * block.line + block.text, "page", "exec")
            with contextlib.redirect_stdout(io.StringIO()) as stream:
                exec(code, namespace)  # noqa: S102  code of the project's own pages
            count, printed = count + 1, stream.getvalue()
        elif block.language == "text" and block.follows and "title=" not in block.info and printed is not None:
            checker = doctest.OutputChecker()
            assert checker.check_output(block.text, printed, LIKE), f"line {block.line}: this was printed\n{printed}"
        elif block.language == "sh":
            for command in commands(block.text):
                count += shell(command)
        elif title := TITLE.search(block.info):
            (folder / title[1]).write_text(block.text, encoding="utf-8")
    return count


def commands(text):
    """The commands of a shell block as lists of words, without comments."""
    lines = text.replace("\\\n", " ").splitlines()
    return [words for line in lines for part in line.split("&&") if (words := shlex.split(part, comments=True))]


def shell(words):
    """Run or check one command, and return whether it ran.

    **Raises:** AssertionError if it fails, names missing files, or is unknown.
    """
    name, *arguments = words
    match (Path(name).name, arguments):
        case ("qtraj", _):
            return qtraj(arguments)
        case ("python" | "python3", ["-m", "qtraj", *rest]):
            return qtraj(rest)
        case ("python" | "python3", ["-m", "venv", folder]):
            assert folder.startswith(".")
        case ("python" | "python3", ["-m", module, *_]):
            assert (ROOT / module.replace(".", "/")).is_dir() or importlib.util.find_spec(module)
        case ("python" | "python3", [script, *_]):
            assert (ROOT / script).is_file(), script
        case ("pytest", _):
            assert all((ROOT / folder).exists() for folder in arguments if folder.startswith(("tests", "bench")))
        case ("pip" | "cd" | "jupytext" | "mkdocs" | "pre-commit" | "jupyter", _):
            pass
        case _:
            raise AssertionError(f"unknown command: {shlex.join(words)}")
    return False


OUTPUTS: dict[tuple[str, ...], dict[Path, bytes]] = {}
"""The files that commands of earlier pages wrote, for commands that read only the project's examples."""


def files():
    """The files of the current folder, except the examples."""
    here = Path()
    return {file for file in here.rglob("*") if file.is_file() and file.parts[0] != "examples"}


def qtraj(arguments):
    """Run the command line, or check that its option exists; return whether it ran.

    A command that several pages repeat runs on the first of them.
    """
    read = [word for word in arguments if Path(word).exists()]
    if "--out" not in arguments or any(not word.startswith("examples/") for word in read):
        return run_command(arguments)
    if written := OUTPUTS.get(tuple(arguments)):
        for file, content in written.items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return True
    before = files()
    ran = run_command(arguments)
    OUTPUTS[tuple(arguments)] = {file: file.read_bytes() for file in files() - before}
    return ran


def run_command(arguments):
    """Run a command, or check that its option exists; return whether it ran."""
    runner = CliRunner()
    if WITHOUT_EFFECT & set(arguments):
        assert arguments[0] in runner.invoke(application(), ["--help"], prog_name="qtraj").output
        return False
    result = runner.invoke(application(), arguments, prog_name="qtraj")
    assert result.exit_code == 0, f"qtraj {shlex.join(arguments)}\n{result.output}\n{result.exception!r}"
    return True


def has_something_to_run(page):
    return any(block.language in {"python", "sh"} for block in blocks(page.read_text(encoding="utf-8")))


SLOW = {
    "docs/tuning.md",
    "docs/howto/feedback.md",
    "docs/howto/gradients.md",
    "docs/howto/own_data.md",
    "docs/howto/tune_batch.md",
}
"""Pages with long computations."""


def test_slow_pages_are_pages():
    assert PAGES.keys() >= SLOW


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [])
        for name, file in PAGES.items()
        if has_something_to_run(file)
    ],
)
def test_the_blocks_of_a_page_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = PAGES[name].read_text(encoding="utf-8")
    # Steps of optax mix the types of numbers, which strict promotion does not allow.
    with jax.numpy_dtype_promotion("standard" if "import optax" in text else "strict"):
        run(text, tmp_path)


@pytest.mark.parametrize("name", PAGES)
def test_no_block_is_overlooked(name):
    """A fence that is indented, or of another language, would not be run."""
    text = PAGES[name].read_text(encoding="utf-8")
    assert re.findall(r"(?m)^(?:[ \t]+```|~~~)", text) == []
    languages = {"", "python", "sh", "text", "toml", "csv", "yaml"}
    assert {block.language for block in blocks(text)} <= languages


@pytest.mark.parametrize("name", PAGES)
def test_every_link_has_a_target(name):
    text = FENCE.sub("", PAGES[name].read_text(encoding="utf-8"))
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, heading = target.partition("#")
        if target.startswith("http"):
            continue
        place = (PAGES[name].parent / file).resolve() if file else PAGES[name]
        assert place.exists(), target
        if heading and place.suffix == ".md":
            assert heading in anchors(place), target


def anchors(file):
    """The anchors of the headings of a page, and the names of the reference."""
    text = FENCE.sub("", file.read_text(encoding="utf-8"))
    headings = re.findall(r"(?m)^#+ (.*)$", text)
    names = re.findall(r"(?m)^::: (\S+)$", text)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings} | {*names}


@pytest.mark.parametrize(
    ("page", "fault"),
    [
        ("```python\nx = 1\n```\n\n```python\nassert x == 2\n```", AssertionError),
        ("```python\nprint(1.5)\n```\n\n```text\n2.5\n```", AssertionError),
        ("```sh\nqtraj evaluate nothing.toml\n```", AssertionError),
        ("```sh\nqtraj evaluate examples/helix.toml --no-such-option\n```", AssertionError),
        ("```sh\n.venv/bin/pytest tests/nowhere\n```", AssertionError),
        ("```sh\nrm -rf results\n```", AssertionError),
        ("```python\nimport warnings\nwarnings.warn('old', DeprecationWarning)\n```", DeprecationWarning),
    ],
)
def test_the_check_detects_a_fault(page, fault, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(fault):
        run(page, tmp_path)


def test_the_check_accepts_good_pages(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (
        '```python\nx = 1\nprint("length", 1.23456)\n```\n\n```text\nlength 1.2...\n```\n\n'
        '```csv title="a.csv"\n1,2\n```\n\n'
        '```python\nfrom pathlib import Path\nassert Path("a.csv").read_text() == "1,2\\n"\n```\n'
        "```sh\nqtraj --install-completion  # changes files of the user's\n"
        "qtraj evaluate examples/helix.toml --samples 2 && .venv/bin/pytest tests\n```"
    )
    assert run(page, tmp_path) == 3


def test_the_recording_of_the_quick_start_is_in_the_examples():
    shown = [
        block.text for block in blocks(PAGES["docs/quickstart.md"].read_text("utf-8")) if "drive.csv" in block.info
    ]
    assert shown == [(ROOT / "examples" / "drive.csv").read_text(encoding="utf-8")]


def test_every_figure_is_shown_and_has_a_script():
    text = "\n".join(file.read_text(encoding="utf-8") for file in PAGES.values())
    shown = {Path(target).name for target in re.findall(r"\]\(([^)\s]+\.svg)\)", text)}
    assert shown == {file.name for file in (ROOT / "docs" / "figures").iterdir()}
    drawn = {f"{name}.svg" for name in runpy.run_path(str(ROOT / "docs" / "pictures.py"))["PICTURES"]}
    others = [*(ROOT / "benchmarks" / "accuracy").glob("*.py"), *(ROOT / "benchmarks").glob("*.py")]
    rest = "\n".join(file.read_text(encoding="utf-8") for file in others)
    assert [name for name in shown - drawn if f'"{name}"' not in rest and f'"{name[:-4]}"' not in rest] == []
