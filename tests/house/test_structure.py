"""The house stays as it is meant: small modules, short functions, plain names, no printing in the library."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted([*(ROOT / "opir_core").rglob("*.py"), *(ROOT / "plugins").glob("*/opir_*/**/*.py")])

LONGEST_MODULE = 320
LONGEST_FUNCTION = 40
SHORT_FUNCTION = 25
VAGUE = {"utils", "util", "helpers", "helper", "manager", "base", "common", "misc"}


Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(path: Path) -> Iterator[Function]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, Function):
            yield node


def lines_of_code(node: Function) -> int:
    """Return the lines of a function without its docstring, which may be as long as it needs."""
    documented = ast.get_docstring(node) is not None
    first = node.body[0]
    return (node.end_lineno or 0) - node.lineno + 1 - ((first.end_lineno or 0) - first.lineno + 1 if documented else 0)


def test_modules_are_small() -> None:
    sizes = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    assert not {name: size for name, size in sizes.items() if size > LONGEST_MODULE}


def test_functions_are_short() -> None:
    found = [
        (lines_of_code(node), f"{path.relative_to(ROOT)}:{node.name}") for path in SOURCES for node in functions(path)
    ]
    assert not [entry for entry in found if entry[0] > LONGEST_FUNCTION]
    assert sorted(size for size, _ in found)[len(found) // 2] <= 7
    assert sum(size <= SHORT_FUNCTION for size, _ in found) >= 0.97 * len(found)


def test_no_module_has_a_vague_name() -> None:
    assert not [path for path in SOURCES if path.stem in VAGUE or path.parent.name in VAGUE]


def test_the_library_does_not_print() -> None:
    printing = re.compile(r"(?<![\w.])print\(")
    allowed = {ROOT / "opir_core" / "cli.py"}
    assert not [path for path in SOURCES if path not in allowed and printing.search(path.read_text(encoding="utf-8"))]


def test_the_core_names_no_constellation_no_web_and_no_broker() -> None:
    forbidden = re.compile(
        r"\b(opir_dsp|opir_sbirs|opir_nextgen|import litestar|import aiokafka|opir_http|opir_kafka|opir_stonesoup)\b"
    )
    core = [path for path in SOURCES if path.is_relative_to(ROOT / "opir_core")]
    named = {str(path.relative_to(ROOT)) for path in core if forbidden.search(code_of(path))}
    assert not named


def code_of(path: Path) -> str:
    """Return a module's source without its docstrings and comments, which may give examples."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            node.value.value = ""
    return ast.unparse(tree)


def test_all_is_sorted() -> None:
    import opir_core

    assert opir_core.__all__ == sorted(opir_core.__all__)
    assert all(hasattr(opir_core, name) for name in opir_core.__all__)
