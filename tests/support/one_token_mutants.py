"""Mutants that differ from a module in one token: where they are, and what each token may become.

Skipped: annotations, decorators, texts (docstrings, f-strings, joined strings, help texts),
`__all__`, and what only type checkers read.
"""

import ast
import io
import tokenize
from bisect import bisect_left
from itertools import accumulate, pairwise

from attrs import frozen

COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
ARITHMETIC: dict[type[ast.operator], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/",)),
    ast.Div: ("/", ("*",)),
    ast.FloorDiv: ("//", ("/",)),
    ast.Mod: ("%", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.BitAnd: ("&", ("|",)),
    ast.BitOr: ("|", ("&",)),
    ast.BitXor: ("^", ("&",)),
    ast.LShift: ("<<", (">>",)),
    ast.RShift: (">>", ("<<",)),
}
UNARY = {ast.Not: "not", ast.USub: "-", ast.Invert: "~"}
OPPOSITES = (
    ("min", "max"),
    ("nanmin", "nanmax"),
    ("minimum", "maximum"),
    ("fmin", "fmax"),
    ("argmin", "argmax"),
    ("sin", "cos"),
    ("arcsin", "arccos"),
    ("asin", "acos"),
    ("sinh", "cosh"),
    ("floor", "ceil"),
    ("any", "all"),
)
OPPOSITE = {name: other for pair in OPPOSITES for name, other in (pair, pair[::-1])}
TEXT_ARGUMENTS = {"help", "description", "doc", "epilog", "metavar"}


@frozen
class Site:
    """A token that may change: its place in the text and what it may become."""

    start: int
    end: int
    line: int
    choices: tuple[str, ...]


def sites(source):
    """Return the tokens of a module that may change, in order of place; raises `SyntaxError`."""
    text = _Text(source)
    result = [site for site in _sites(ast.parse(source), text) if site.choices]
    return sorted(result, key=lambda site: (site.start, site.end))


def mutated(source, site, choice):
    """Return the source with the token of a site replaced."""
    return source[: site.start] + choice + source[site.end :]


class _Text:
    """A source with the offsets of its nodes and tokens."""

    def __init__(self, source):
        self.source = source
        self._lines = list(io.StringIO(source))
        self._starts = list(accumulate((len(line) for line in self._lines), initial=0))
        read = tokenize.generate_tokens(io.StringIO(source).readline)
        spelled = (token for token in read if token.type in (tokenize.OP, tokenize.NAME))
        self._tokens = [
            (self._at(*token.start), self._at(*token.end), token.string) for token in spelled
        ]

    def _at(self, line, column):
        return self._starts[line - 1] + column

    def start(self, node):
        return self._offset(node.lineno, node.col_offset)

    def end(self, node):
        return self._offset(node.end_lineno or 0, node.end_col_offset or 0)

    def _offset(self, line, column_bytes):
        return self._at(line, len(self._lines[line - 1].encode()[:column_bytes].decode()))

    def site(self, start, end, choices):
        return Site(start, end, self.source.count("\n", 0, start) + 1, tuple(choices))

    def operator(self, words, end, start, choices):
        """Return the site of an operator of one or two words between two operands, or at the start
        of one.
        """
        expected = words.split()
        inside = self._tokens[
            bisect_left(self._tokens, (end,)) : bisect_left(self._tokens, (start,))
        ]
        at = next(index for index, (_, _, word) in enumerate(inside) if word == expected[0])
        return self.site(inside[at][0], inside[at + len(expected) - 1][1], choices)


def _sites(node, text, *, in_function=False):
    if _is_skipped(node, in_function=in_function):
        return
    yield from _own_sites(node, text)
    in_function = in_function or isinstance(
        node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
    )
    for child in _code_below(node):
        yield from _sites(child, text, in_function=in_function)


def _is_skipped(node, *, in_function):
    match node:
        case ast.JoinedStr() | ast.arg():
            return True
        case ast.BinOp(op=ast.BitOr()) if not in_function:
            return True  # a union of types
        case ast.BinOp():
            return any(_is_text(side) for side in (node.left, node.right))
        case ast.keyword():
            return node.arg in TEXT_ARGUMENTS
        case ast.Assign(targets=[ast.Name(id="__all__")]):
            return True
        case _:
            return False


def _is_text(node):
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    )


def _code_below(node):
    """Return the children of a node but annotations, decorators and what only type checkers
    read.
    """
    if isinstance(node, ast.If) and ast.unparse(node.test) in {
        "TYPE_CHECKING",
        "typing.TYPE_CHECKING",
    }:
        return list(node.orelse)
    skipped = {"annotation", "returns", "decorator_list", "type_params"}
    fields = (value for name, value in ast.iter_fields(node) if name not in skipped)
    below = [item for value in fields for item in (value if isinstance(value, list) else [value])]
    return [item for item in below if isinstance(item, ast.AST)]


def _own_sites(node, text):
    """Yield the sites of a node itself, without those of its children."""
    match node:
        case ast.Compare() | ast.BoolOp() | ast.BinOp() | ast.AugAssign() | ast.UnaryOp():
            yield from _operators(node, text)
        case ast.Return(value=ast.expr() as value) if not (
            isinstance(value, ast.Constant) and value.value is None
        ):
            start = text.start(node)
            yield text.site(start, start + len("return"), ["return None;"])
        case ast.Slice():
            for bound in filter(None, (node.lower, node.upper)):
                yield _bound(bound, text)
        case ast.Constant() | ast.Name() | ast.Attribute():
            yield _word(node, text)


def _operators(node, text):
    match node:
        case ast.Compare():
            for op, (operand, right) in zip(
                node.ops, pairwise([node.left, *node.comparators]), strict=True
            ):
                words, choices = COMPARISONS[type(op)]
                yield text.operator(words, text.end(operand), text.start(right), choices)
        case ast.BoolOp():
            word, opposite = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for operand, right in pairwise(node.values):
                yield text.operator(word, text.end(operand), text.start(right), [opposite])
        case ast.BinOp() if type(node.op) in ARITHMETIC:
            word, choices = ARITHMETIC[type(node.op)]
            yield text.operator(word, text.end(node.left), text.start(node.right), choices)
        case ast.AugAssign() if type(node.op) in ARITHMETIC:
            word, choices = ARITHMETIC[type(node.op)]
            changed = [f"{choice}=" for choice in choices]
            yield text.operator(f"{word}=", text.end(node.target), text.start(node.value), changed)
        case ast.UnaryOp() if type(node.op) in UNARY:
            yield text.operator(
                UNARY[type(node.op)], text.start(node), text.start(node.operand), [""]
            )


def _bound(bound, text):
    start = text.start(bound)
    end = text.end(bound)
    spelled = text.source[start:end]
    shifted = (
        ()
        if isinstance(bound, ast.Constant | ast.UnaryOp)
        else (f"({spelled}) + 1", f"({spelled}) - 1")
    )
    return text.site(start, end, ["", *shifted])


def _word(node, text):
    end = text.end(node)
    if isinstance(node, ast.Constant):
        return text.site(text.start(node), end, _other_values(node.value))
    name = node.id if isinstance(node, ast.Name) else node.attr
    read = isinstance(node.ctx, ast.Load) and name in OPPOSITE
    return text.site(end - len(name), end, [OPPOSITE[name]] if read else [])


def _other_values(value):
    """Return the spellings of what a constant may become: the other truth value, or one more and
    one less.
    """
    if isinstance(value, bool):
        return [repr(not value)]
    if isinstance(value, int | float):
        return [
            f"({other!r})" if other < 0 else repr(other)
            for other in (value + 1, value - 1)
            if other != value
        ]
    return []
