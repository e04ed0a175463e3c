"""XML as plain nodes with their lines; without document types, whose entities can grow without
bound.
"""

from collections.abc import Iterator
from contextlib import suppress
from xml.parsers import expat

from attrs import Factory, define

from opir_core.plugin import BadFileError

#: The deepest nesting that is read.
_DEEPEST = 64


@define(eq=False)
class XmlNode:
    """An element: its name without namespace, its attributes, its text, its children, and its
    line.
    """

    name: str
    line: int
    attributes: dict[str, str] = Factory(dict)
    pieces: list[str] = Factory(list)
    children: list["XmlNode"] = Factory(list)

    @property
    def text(self) -> str:
        """Return the text of the element itself, without white space at its ends."""
        return "".join(self.pieces).strip()

    def all(self, name: str) -> Iterator["XmlNode"]:
        """Yield the elements of a name inside, in order, whatever their depth."""
        for child in self.children:
            if child.name == name:
                yield child
            else:
                yield from child.all(name)

    def child(self, name: str) -> "XmlNode | None":
        """Return the first child of a name, or None."""
        return next((child for child in self.children if child.name == name), None)

    def text_of(self, name: str) -> str:
        """Return the text of the first child of a name, "" without one."""
        child = self.child(name)
        return "" if child is None else child.text

    def texts(self) -> dict[str, str]:
        """Return the texts of the children by name, comments left out."""
        return {child.name: child.text for child in self.children if child.name != "COMMENT"}


def xml_root(text: str) -> XmlNode:
    """Return the outermost element of a text; raises `BadFileError` with the line that is no
    XML.
    """
    reader = _Reader()
    try:
        reader.parser.Parse(text.encode("utf-8", "surrogatepass"), True)
    except expat.ExpatError as error:
        raise BadFileError(
            f"line {error.lineno}: is not XML: {expat.errors.messages[error.code]}"
        ) from error
    if not reader.top.children:
        raise BadFileError("has no XML element")
    return reader.top.children[0]


def root_name(text: str) -> str:
    """Return the name of the outermost element of a text, "" if it is not XML."""
    reader = _Reader(only_root=True)
    with suppress(expat.ExpatError, BadFileError):
        reader.parser.Parse(text[:20_000].encode("utf-8", "surrogatepass"), False)
    return reader.top.children[0].name if reader.top.children else ""


def has_root(text: str, name: str) -> bool:
    """Whether a text is XML with an outermost element of a name."""
    return text.lstrip()[:1] == "<" and root_name(text) == name


def has_message(text: str, kind: str) -> bool:
    """Whether a text is a message of CCSDS of a kind in XML, or one of several (ndm) that has
    one.
    """
    return has_root(text, kind) or (has_root(text, "ndm") and f"<{kind}" in text)


def metadata_and_data(segment: XmlNode) -> tuple[XmlNode, XmlNode]:
    """Return both blocks of a segment of a message; raises `BadFileError` for a missing one."""
    blocks = []
    for name in ("metadata", "data"):
        block = segment.child(name)
        if block is None:
            raise BadFileError(f"line {segment.line}: this segment has no {name}")
        blocks.append(block)
    return blocks[0], blocks[1]


class _Reader:
    """Builds the nodes."""

    def __init__(self, *, only_root: bool = False) -> None:
        self.parser = expat.ParserCreate("utf-8")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype
        self.top = XmlNode("", 0)
        self._open = [self.top]
        if not only_root:
            self.parser.CharacterDataHandler = self._add_text

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self._open) > _DEEPEST:
            self._refuse(f"is nested deeper than {_DEEPEST} elements")
        node = XmlNode(name.rpartition(":")[2], self.parser.CurrentLineNumber, attributes)
        self._open[-1].children.append(node)
        self._open.append(node)

    def _end(self, _name: str) -> None:
        self._open.pop()

    def _add_text(self, text: str) -> None:
        self._open[-1].pieces.append(text)

    def _refuse_doctype(self, *_declaration: object) -> None:
        self._refuse("has a document type, which is not read; leave it out")

    def _refuse(self, words: str) -> None:
        raise BadFileError(f"line {self.parser.CurrentLineNumber}: {words}")
