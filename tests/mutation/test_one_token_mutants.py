"""Where a module may change by one token, and into what; what only people and type checkers read
stays.
"""

import ast

import pytest
from one_token_mutants import mutated, sites
from repository import ROOT


def mutants_of(source):
    return [mutated(source, site, choice) for site in sites(source) for choice in site.choices]


@pytest.mark.parametrize(
    ("source", "mutants"),
    [
        ("a < b", ["a <= b", "a >= b"]),
        ("a <= b", ["a < b", "a > b"]),
        ("a > b", ["a >= b", "a <= b"]),
        ("a >= b", ["a > b", "a < b"]),
        ("a == b", ["a != b"]),
        ("a != b", ["a == b"]),
        ("a is b", ["a is not b"]),
        ("a is not b", ["a is b"]),
        ("a in b", ["a not in b"]),
        ("a not in b", ["a in b"]),
        ("a < b != c", ["a <= b != c", "a >= b != c", "a < b == c"]),
        ("a + b", ["a - b"]),
        ("a - (-b)", ["a + (-b)", "a - (b)"]),
        ("(a + b) * (c)", ["(a - b) * (c)", "(a + b) / (c)"]),
        ("a / b", ["a * b"]),
        ("a // b", ["a / b"]),
        ("a % b", ["a * b"]),
        ("a ** b", ["a * b"]),
        ("def f(): return a & b", ["def f(): return None; a & b", "def f(): return a | b"]),
        ("f = lambda: a | b", ["f = lambda: a & b"]),
        ("a ^ b", ["a & b"]),
        ("a << b", ["a >> b"]),
        ("a >> b", ["a << b"]),
        ("a -= b", ["a += b"]),
        ("a **= b", ["a *= b"]),
        ("a and b and c", ["a or b and c", "a and b or c"]),
        ("a or b", ["a and b"]),
        ("not a", [" a"]),
        ("~a", ["a"]),
        ("2", ["3", "1"]),
        ("0", ["1", "(-1)"]),
        ("0.5", ["1.5", "(-0.5)"]),
        ("1e300", []),
        ("True", ["False"]),
        ("False", ["True"]),
        ("None", []),
        ("'text'", []),
        ("max(a, b)", ["min(a, b)"]),
        ("np.cos(a)", ["np.sin(a)"]),
        ("max = a", []),
        ("a[b:]", ["a[:]", "a[(b) + 1:]", "a[(b) - 1:]"]),
        ("a[:-1]", ["a[:1]", "a[:]", "a[:-2]", "a[:-0]"]),
        ("def f(): return (\n    a\n)", ["def f(): return None; (\n    a\n)"]),
        ("def f(): return None", []),
        ("ä = 'ü' if b == 'ö' else c", ["ä = 'ü' if b != 'ö' else c"]),
    ],
)
def test_each_token_becomes_what_its_kind_may(source, mutants):
    assert mutants_of(source) == mutants


@pytest.mark.parametrize(
    "source",
    [
        "def f(a: int | None, *b: C[2]) -> D[3]: ...",
        "a: Literal[1]",
        "Alias = int | None",
        "@frozen(slots=True)\nclass A: ...",
        "f'{a + 1} of {b}'",
        "'a' + b",
        "b % 'a'",
        "flag(help=describe(1))",
        "__all__ = [*names[1:]]",
        "if TYPE_CHECKING:\n    a = 1",
    ],
)
def test_texts_types_and_decorators_stay(source):
    assert sites(source) == []


def test_what_runs_if_types_are_not_checked_may_change():
    assert mutants_of("if TYPE_CHECKING:\n    a = True\nelse:\n    b = True") == [
        "if TYPE_CHECKING:\n    a = True\nelse:\n    b = False"
    ]


def test_defaults_may_change_though_annotations_stay():
    assert mutants_of("def f(a: C[5] = True): ...") == ["def f(a: C[5] = False): ..."]


def test_sites_know_their_lines():
    assert [site.line for site in sites("a = (\n    b\n    + c\n)\n\nd = True\n")] == [3, 6]


def test_every_mutant_of_a_module_is_another_program():
    source = (ROOT / "opir_core" / "geometry" / "ellipsoid.py").read_text(encoding="utf-8")
    program = ast.dump(ast.parse(source))
    mutants = mutants_of(source)
    assert len(mutants) > 50
    assert all(ast.dump(ast.parse(mutant)) != program for mutant in mutants)
