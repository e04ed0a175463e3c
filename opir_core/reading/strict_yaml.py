"""YAML text to nodes, refusing what makes YAML surprising.

PyYAML's parser supplies events; nothing of its constructors or resolvers is used. Aliases, anchors,
tags, merge keys, directives, second documents, duplicate keys and keys that are not text are
refused, and so is all that `opir_core.reading.strict_yaml` refuses. Nesting and the number of
values are bounded while reading, so no text is costly.
"""

import math
import re
from typing import Any

import yaml
from attrs import evolve

from opir_core.reading.nodes import (
    MAXIMUM_DEPTH,
    MAXIMUM_DIGITS,
    MAXIMUM_VALUES,
    UNREADABLE,
    Complaint,
    InvalidNode,
    Node,
    Place,
    SwitchWord,
    complaints_inside,
    key_step,
    place_text,
    unprintable_complaint,
)

_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_SWITCHES = {case(word): on for word, on in (("yes", True), ("no", False), ("on", True), ("off", False))
             for case in (str.lower, str.capitalize, str.upper)}  # fmt: skip
_FIRST_OF_NUMBER = frozenset("0123456789+-.")

_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_DECIMAL = re.compile(r"[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_ODD = (
    (re.compile(r"[-+]?\.(inf|Inf|INF|nan|NaN|NAN)"), "{0} is not a finite number"),
    (
        re.compile(r"[-+]?[0-9][0-9_]*(:[0-9]+)+(\.[0-9_]*)?"),
        (
            "{0} is a number in base 60 to some YAML readers; write a decimal number, or '{0}' in"
            " quotes for text"
        ),
    ),
    (
        re.compile(r"[-+]?0[xXoObB][0-9a-fA-F_]+"),
        "{0} is not a decimal number; write one, or '{0}' in quotes for text",
    ),
    (
        re.compile(
            r"[-+]?[0-9][0-9_]*_[0-9_]*(\.[0-9_]*)?([eE][-+]?[0-9]+)?|[-+]?[0-9]+\.[0-9_]*_[0-9_]*"
        ),
        "{0} has '_' between digits; leave it out, or write '{0}' in quotes for text",
    ),
    (
        re.compile(r"[-+]?0[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?"),
        (
            "{0} begins with a zero, which is octal to some YAML readers; leave it out, or write"
            " '{0}'"
            " in quotes for text"
        ),
    ),
)


def plain_value(text: str) -> Any:
    """Return the value of an unquoted scalar: None, a truth value, an int, a float, a `SwitchWord`
    or text.

    Raises `ValueError`, with words for the user, where that depends on who reads it or would not
    keep the number.
    """
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if text[0] in _FIRST_OF_NUMBER:
        return _number_or_text(text)
    return SwitchWord(text) if text in _SWITCHES else quoted_value(text)


def quoted_value(text: str) -> str:
    """Return a text unchanged; raises `ValueError` for unprintable characters."""
    complaint = unprintable_complaint(text)
    if complaint:
        raise ValueError(complaint)
    return text


def is_on(word: SwitchWord) -> bool:
    """Return the truth value of a switch word."""
    return _SWITCHES[word]


def is_decimal_text(text: str) -> bool:
    """Return whether a text would be a number without its quotes."""
    return _DECIMAL.fullmatch(text) is not None


def _number_or_text(text: str) -> int | float | str:
    if _WHOLE.fullmatch(text):
        digits = len(text.lstrip("+-"))
        if digits > MAXIMUM_DIGITS:
            raise ValueError(
                f"a whole number of {digits} digits; at most {MAXIMUM_DIGITS} are read"
            )
        return int(text)
    if _DECIMAL.fullmatch(text):
        number = float(text)
        short = text if len(text) <= MAXIMUM_DIGITS else f"{text[:MAXIMUM_DIGITS]}..."
        if math.isinf(number):
            raise ValueError(f"{short} is too large for a number; the largest is about 1.8e308")
        if number == 0.0 and re.search("[1-9]", re.split("[eE]", text)[0]):
            raise ValueError(f"{short} is too small for a number and would be read as 0")
        return number
    for pattern, complaint in _ODD:
        if pattern.fullmatch(text):
            raise ValueError(
                complaint.format(
                    text if len(text) <= MAXIMUM_DIGITS else f"{text[:MAXIMUM_DIGITS]}..."
                )
            )
    return quoted_value(text)


#: libyaml's parser where PyYAML has it, else PyYAML's own: the same events, more slowly.
PARSER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

#: PyYAML's own pattern of what must not stand in a text (YAML 1.1, section 5.1); compiling it a
#: second time is slow.
_UNPRINTABLE: re.Pattern[str] = yaml.reader.Reader.NON_PRINTABLE

_SYNTAX = (
    ("mapping values are not allowed", "a ':' that fits no key: text with ': ' in it needs quotes"),
    ("could not find expected ':'", "there is no ':' after this key"),
    ("cannot start any token", "text that begins with this character needs quotes"),
    ("end of stream", "the quotes are not closed"),
    ("stream end", "the bracket is not closed"),
    ("expected ',' or '", "a ',' or a closing bracket is missing before this"),
    (
        "expected key",
        "the keys of one block, and the '-' of one list, must begin in the same column",
    ),
    ("block end", "the keys of one block, and the '-' of one list, must begin in the same column"),
    ("document start", "something follows after the end"),
    (
        "'-' indicator",
        "the keys of one block, and the '-' of one list, must begin in the same column",
    ),
    ("node content", "a value is missing before this"),
    (
        "escape",
        (
            "there is no such escape in double quotes; write '\\\\' for a backslash, or use single"
            " quotes"
        ),
    ),
)


def node_of_yaml(text: str, origin: str | None = None) -> Node:
    """Return the nodes of a YAML document.

    `origin` stands in for line and column where the text is not a file. What is wrong with single
    values waits in the nodes; `InvalidNode` is raised where the text as a whole cannot be read.
    """
    _refuse_unprintable(text, origin)
    composer = _Composer(origin)
    try:
        for event in yaml.parse(text, Loader=PARSER):
            composer.take(event)
    except yaml.MarkedYAMLError as error:
        composer.stop(*_syntax_message(error, origin is None))
    if composer.root is None:
        raise InvalidNode([Complaint("the document is empty", origin)])
    return composer.root


def node_of_scalar(text: str, origin: str) -> Node:
    """Return the node of an unquoted scalar, whatever characters it holds."""
    try:
        return Node(plain_value(text), origin, None, text)
    except ValueError as error:
        return Node(UNREADABLE, origin, None, text, (Complaint(str(error), origin),))


class _Composer:
    """Events in, nodes out: a stack of the open blocks and lists, each block with the key that
    waits for its value.
    """

    def __init__(self, origin: str | None) -> None:
        self.root: Node | None = None
        self._origin = origin
        self._open: list[Node] = []
        self._keys: list[tuple[str | None, Place] | None] = []
        self._values = 0

    def take(self, event: Any) -> None:
        """Take in one event of the parser."""
        if isinstance(event, yaml.ScalarEvent):
            self._add(self._scalar(event), event)
        elif isinstance(event, yaml.MappingStartEvent):
            self._container(event, {})
        elif isinstance(event, yaml.SequenceStartEvent):
            self._container(event, [])
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            self._open.pop()
            self._keys.pop()
        elif isinstance(event, yaml.AliasEvent):
            self._add(
                self._unreadable("aliases (*name) are not read; write the value out", event), event
            )
        elif isinstance(event, yaml.DocumentStartEvent):
            if self.root is not None:
                self.stop(
                    "a second document begins here; a scene is one document", event.start_mark
                )
            if event.version or event.tags:
                self.stop(
                    "directives (%YAML, %TAG) are not read; leave the line out", event.start_mark
                )

    def stop(self, message: str, mark: Any) -> None:
        """Raise the error of the text, after the earlier ones."""
        complaints = complaints_inside(self.root) if self.root else ()
        raise InvalidNode([*complaints, Complaint(message, self._place(mark))])

    def _scalar(self, event: yaml.ScalarEvent) -> Node:
        plain = event.implicit[0]
        node = Node(UNREADABLE, self._place(event.start_mark), None, event.value if plain else None)
        node.complaints = self._strangeness(event)
        try:
            if event.tag is None:
                node.value = plain_value(event.value) if plain else quoted_value(event.value)
        except ValueError as error:
            node.complaints = (*node.complaints, Complaint(str(error), node.place))
        return node

    def _container(self, event: Any, value: Any) -> None:
        """Begin a block or a list; one with a tag is read to its end and left out."""
        if len(self._open) >= MAXIMUM_DEPTH:
            self.stop(f"blocks and lists are more than {MAXIMUM_DEPTH} deep here", event.start_mark)
        node = Node(value, self._place(event.start_mark), complaints=self._strangeness(event))
        self._add(node if event.tag is None else evolve(node, value=UNREADABLE), event)
        self._open.append(node)
        self._keys.append(None)

    def _strangeness(self, event: Any) -> tuple[Complaint, ...]:
        if event.tag is None and event.anchor is None:
            return ()
        tag = (event.tag or "").replace("tag:yaml.org,2002:", "!!")
        feature = f"tags ({tag})" if tag else f"anchors (&{event.anchor})"
        return (
            Complaint(
                f"{feature} are not read; write the plain value", self._place(event.start_mark)
            ),
        )

    def _unreadable(self, message: str, event: Any) -> Node:
        place = self._place(event.start_mark)
        return Node(UNREADABLE, place, complaints=(Complaint(message, place),))

    def _add(self, node: Node, event: Any) -> None:
        self._values += 1
        if self._values > MAXIMUM_VALUES:
            self.stop(f"there are more than {MAXIMUM_VALUES} values", event.start_mark)
        if not self._open:
            self.root = node
        elif isinstance(self._open[-1].value, list):
            self._open[-1].value.append(node)
        elif self._keys[-1] is None:
            self._keys[-1] = self._key(node), node.place
        else:
            key, key_place = self._keys[-1]
            self._keys[-1] = None
            if key is not None:
                self._set(self._open[-1], key, key_place, node)

    def _key(self, node: Node) -> str | None:
        """Return the key of a node; None, with a complaint, unless it is text."""
        self._open[-1].complaints = (*self._open[-1].complaints, *node.complaints)
        if type(node.value) is str and node.written != "<<":
            return node.value
        if node.written == "<<":
            self._complain("merge keys (<<) are not read; write the keys out", node.place)
        elif isinstance(node.value, list | dict):
            self._complain("a key is a list or a block; keys are text", node.place)
        elif node.value is not UNREADABLE:
            self._complain(
                f"the key {node.written or 'of nothing'} is not text; write it in quotes",
                node.place,
            )
        return None

    def _set(self, block: Node, key: str, key_place: Place, node: Node) -> None:
        node.key_place = key_place
        value = block.value.setdefault(key, node)
        if value is not node:
            where = f"; the first is in {place_text(value.key_place)}" if value.key_place else ""
            complaint = Complaint(f"the key is written twice{where}", key_place, (key_step(key),))
            block.complaints = (*block.complaints, complaint)

    def _complain(self, message: str, place: Place) -> None:
        self._open[-1].complaints = (*self._open[-1].complaints, Complaint(message, place))

    def _place(self, mark: Any) -> Place:
        return self._origin or (mark.line + 1, mark.column + 1)


def _refuse_unprintable(text: str, origin: str | None) -> None:
    character = re.search("\t", text) or _UNPRINTABLE.search(text)
    if character is None:
        return
    line = text.count("\n", 0, character.start()) + 1
    place = origin or (line, character.start() - text.rfind("\n", 0, character.start()))
    if character[0] == "\t":
        raise InvalidNode(
            [Complaint("a tab stands here; scenes are indented and spaced with blanks", place)]
        )
    raise InvalidNode(
        [Complaint(f"U+{ord(character[0]):04X} stands here, which is not text", place)]
    )


def _syntax_message(error: yaml.MarkedYAMLError, has_lines: bool) -> tuple[str, Any]:
    """Return the message of a parser error, in our words where there are some, and the mark of its
    place.
    """
    problem = error.problem or "this does not follow the rules of YAML"
    words = next((text for pattern, text in _SYNTAX if pattern in problem), problem)
    begun = error.context_mark
    mark = error.problem_mark or error.context_mark
    if not has_lines or begun is None or mark is None or begun.line == mark.line:
        return f"not YAML: {words}", mark
    if "expected ':'" in problem:
        return f"not YAML: {words}", begun
    return f"not YAML: {words}, in the block that begins in line {begun.line + 1}", mark
