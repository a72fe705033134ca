"""Rules for the code that no linter checks: see CONTRIBUTING.md."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
ROOT = REPOSITORY / "src" / "qtraj"
FILES = {str(file.relative_to(ROOT)): file for file in sorted(ROOT.rglob("*.py"))}
OTHERS = [file for folder in ("tests", "benchmarks") for file in sorted((REPOSITORY / folder).rglob("*.py"))]

MAXIMUM_LINES = 300
UNSAFE_MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve"}
UNSAFE_CALLS = {"eval", "exec", "compile"}
UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX|HACK)\b")
VERSION = "_version.py"  # one line, which the build reads


def faults(code):
    """The violations of the rules in a module, as a list of 'line: fault'."""
    result = [(1, f"more than {MAXIMUM_LINES} lines")] if len(code.splitlines()) > MAXIMUM_LINES else []
    tree = ast.parse(code)
    if not ast.get_docstring(tree):
        result.append((1, "no docstring"))
    for node in ast.walk(tree):
        result += [(getattr(node, "lineno", 1), fault) for fault in _node_faults(node)]
    tokens = tokenize.generate_tokens(io.StringIO(code).readline) if UNFINISHED.search(code) else ()
    result += _defined_twice(tree)
    for token in tokens:
        if token.type in {tokenize.COMMENT, tokenize.STRING} and UNFINISHED.search(token.string):
            result.append((token.start[0], "unfinished"))
    return [f"{line}: {fault}" for line, fault in sorted(result)]


def _defined_twice(tree):
    """The second definitions of a name at the top level, which change what functions above them use."""
    seen = set()
    for node in tree.body:
        for name in _defined(node):
            if name in seen and name != "_":
                yield node.lineno, f"defines {name} again"
            seen.add(name)


def _defined(node):
    match node:
        case ast.FunctionDef(decorator_list=[*_, ast.Name(id="overload")]):
            return []
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.Assign(targets=targets):
            return [x.id for x in ast.walk(ast.Tuple(targets)) if isinstance(x, ast.Name) and _is_stored(x)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
    return []


def _is_stored(name):
    return isinstance(name.ctx, ast.Store)


def _node_faults(node):
    match node:
        case ast.Assert():
            yield "assert"
        case ast.ExceptHandler(type=None):
            yield "bare except"
        case ast.Import(names=names):
            yield from (f"imports {n.name}" for n in names if n.name.split(".")[0] in UNSAFE_MODULES)
        case ast.ImportFrom(module=str(module), level=0) if module.split(".")[0] in UNSAFE_MODULES:
            yield f"imports {module}"
        case ast.Call(func=ast.Name(id=name)) if name in UNSAFE_CALLS:
            yield f"calls {name}"
        case ast.Name(id="NotImplementedError"):
            yield "NotImplementedError"
        case ast.keyword(arg="allow_pickle", value=ast.Constant(value=True)):
            yield "allow_pickle"


@pytest.mark.parametrize("name", sorted(FILES.keys() - {VERSION}))
def test_modules_follow_the_rules(name):
    assert faults(FILES[name].read_text(encoding="utf-8")) == []


def test_tests_and_benchmarks_define_each_name_once():
    faults = {str(file): [*_defined_twice(ast.parse(file.read_text(encoding="utf-8")))] for file in OTHERS}
    assert {file: found for file, found in faults.items() if found} == {}
    assert len(faults) > 200


def test_the_sources_are_found():
    assert "foundation/types.py" in {name.replace("\\", "/") for name in FILES}


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("import pickle", "imports pickle"),
        ("from pickle import loads", "imports pickle"),
        ("def f():\n    import dill.source", "imports dill.source"),
        ("x = eval('1')", "calls eval"),
        ("exec('1')", "calls exec"),
        ("assert True", "assert"),
        ("raise NotImplementedError", "NotImplementedError"),
        ("raise NotImplementedError('later')", "NotImplementedError"),
        ("try:\n    pass\nexcept:\n    pass", "bare except"),
        ("np.load(f, allow_pickle=True)", "allow_pickle"),
        ("x = 1  # TODO: later", "unfinished"),
        ("def f():\n    '''FIXME'''", "unfinished"),
        ("x = 1\ny, x = 2, 3", "defines x again"),
        ("x: int = 1\ndef x():\n    pass", "defines x again"),
        ("_ = 1\n" * MAXIMUM_LINES, f"more than {MAXIMUM_LINES} lines"),
    ],
)
def test_the_check_detects_a_fault(body, fault):
    [result] = faults(f'"""A module."""\n{body}')
    assert result.partition(": ")[2] == fault


def test_the_check_detects_a_missing_docstring_and_accepts_good_code():
    assert faults("x = 1\n") == ["1: no docstring"]
    assert faults('"""A module."""\n\n\ndef evaluate(x):\n    return model.eval(x)\n') == []
    assert faults('"""A module."""\n@overload\ndef f(x): ...\ndef f(y):\n    z = y\n    z = y.x = y[0] = z\n') == []


def test_slow_tests_are_marked_in_their_own_file():
    """`.ci/run` collects only the test files that contain the mark."""
    helpers = [file for file in OTHERS if not file.name.startswith("test_")]
    assert not [file for file in helpers if re.search(r"mark\.slow", file.read_text(encoding="utf-8"))]
