"""How heavy Python code is to read, by measures that joining lines does not better."""

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from pathlib import Path
from typing import NamedTuple

COLUMNS = 100

#: A token is a name, a number, a string or an operator; comments and docstrings are not counted.
TOKEN_TYPES = frozenset({tokenize.NAME, tokenize.NUMBER, tokenize.STRING, tokenize.OP})

#: From Python 3.12 on an f-string is several tokens, between these.
F_STRING_START = getattr(tokenize, "FSTRING_START", -1)
F_STRING_END = getattr(tokenize, "FSTRING_END", -1)

#: Pronouns, adverbs and participles that stand where a noun should.
NOT_NOUNS = frozenset(
    re.findall(
        r"\w+",
        "mine theirs ours own others other one ones each every some few many most both rest found "
        "made given known kept left said told then now here there ahead before after fresh whole "
        "part parts what which whose who apart away near far again late early first last good bad "
        "due used wanted asked same alike seen joined chosen several sought ",
    )
)

CONSTANT_NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")

#: Endings of functions that compute for one row what another computes for all.
TWIN_NAME = re.compile(r"_(of_one|alone|one)$")

FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)


class CodeMeasures(NamedTuple):
    """Measures of the Python files of a folder.

    `tokens`: of all code. `function_p90`, `function_most`: tokens of a function's body. `packed`:
    share of assignments that give several values at once. `wide`: share of lines over 100 columns.
    `not_nouns`: share of variables named by a pronoun, adverb or participle. `constants`: numeric
    module constants per 1 000 lines. `twins`: functions that compute for one row what another
    computes for all.
    """

    tokens: int
    function_p90: int
    function_most: int
    packed: float
    wide: float
    not_nouns: float
    constants: float
    twins: int


def python_files(folder):
    """Return the Python files of a folder, without templates and builds."""
    return [
        path
        for path in sorted(folder.rglob("*.py"))
        if not {"templates", "build"}.intersection(path.relative_to(folder).parts)
    ]


def docstring_rows(tree):
    """Return the line numbers of all docstrings."""
    rows = set[int]()
    for node in ast.walk(tree):
        if (
            isinstance(node, (*FUNCTION, ast.ClassDef, ast.Module))
            and ast.get_docstring(node) is not None
        ):
            docstring = node.body[0]
            rows.update(range(docstring.lineno, (docstring.end_lineno or docstring.lineno) + 1))
    return rows


def tokens_by_row(text, tree):
    """Return the number of tokens of each line; an f-string is one, on every Python."""
    skipped = docstring_rows(tree)
    rows = Counter()
    depth = 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        is_counted = depth == 0 and token.type in (*TOKEN_TYPES, F_STRING_START)
        depth += (token.type == F_STRING_START) - (token.type == F_STRING_END)
        if is_counted and token.start[0] not in skipped:
            rows[token.start[0]] += 1
    return rows


def body_sizes(tree, tokens):
    """Yield the number of tokens of each function's body."""
    for node in ast.walk(tree):
        if isinstance(node, FUNCTION):
            yield sum(tokens[row] for row in range(node.body[0].lineno, (node.end_lineno or 0) + 1))


def is_packed(node):
    """Whether an assignment gives several values at once: `a, b = x, y` or `a = b = x`."""
    is_tuple = isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
    return is_tuple or len(node.targets) > 1


def bound_names(tree):
    """Yield the names of variables and arguments, once for each binding."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg) and node.arg not in ("self", "cls"):
            yield node.arg


def is_number(value):
    """Whether an expression is made of numbers alone."""
    leaves = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return bool(leaves) and all(type(leaf) in (int, float) for leaf in leaves)


def numeric_constants(tree):
    """Yield the names of the module constants that are made of numbers alone."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        else:
            continue
        if node.value is not None and is_number(node.value):
            names = (
                name.id
                for target in targets
                for name in ast.walk(target)
                if isinstance(name, ast.Name)
            )
            yield from filter(CONSTANT_NAME.fullmatch, names)


def twins(tree):
    """Yield the names of functions that compute for one row what another computes for all."""
    for node in ast.walk(tree):
        if isinstance(node, FUNCTION) and TWIN_NAME.search(node.name):
            yield node.name


def measures_of(folder):
    """Return the measures of a folder."""
    rows = list[str]()
    sizes = list[int]()
    names = list[str]()
    assignments = list[bool]()
    total = Counter[str]()
    for path in python_files(folder):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        tokens = tokens_by_row(text, tree)
        rows += text.splitlines()
        sizes += body_sizes(tree, tokens)
        names += bound_names(tree)
        assignments += (is_packed(node) for node in ast.walk(tree) if isinstance(node, ast.Assign))
        total["tokens"] += tokens.total()
        total["constants"] += sum(1 for _ in numeric_constants(tree))
        total["twins"] += sum(1 for _ in twins(tree))
    sizes = sorted(sizes) or [0]
    return CodeMeasures(
        tokens=total["tokens"],
        function_p90=sizes[int(0.9 * len(sizes))],
        function_most=sizes[-1],
        packed=sum(assignments) / max(len(assignments), 1),
        wide=sum(len(row) > COLUMNS for row in rows) / max(len(rows), 1),
        not_nouns=sum(name.strip("_") in NOT_NOUNS for name in names) / max(len(names), 1),
        constants=1000 * total["constants"] / max(len(rows), 1),
        twins=total["twins"],
    )


if __name__ == "__main__":
    for name in sys.argv[1:]:
        sys.stdout.write(f"{name}: {measures_of(Path(name))}\n")
