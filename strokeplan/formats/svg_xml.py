"""XML of an untrusted SVG as a small tree, by expat, in bounded time and memory.

Nothing is fetched and nothing runs. Entities are expanded only where they cannot grow: Illustrator's files
declare one for each namespace, so a document type is fine, but one that names a file, holds markup or refers
to another entity is refused, as is whatever could exceed the limits below. Names lose the namespace of SVG
(and none at all is taken for it); those of Inkscape, XLink and strokeplan become a prefix.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.parsers import expat

from strokeplan.errors import FormatError

MAX_BYTES = 1 << 27
"""Largest SVG read, unpacked: some 800,000 strokes; a gzip bomb stops here."""
MAX_ELEMENTS = 1_000_000
MAX_ATTRIBUTES = 20_000_000
MAX_DEPTH = 200
"""Elements within each other; what people and programs draw stays far below."""
MAX_ENTITY_TEXT = 1 << 24
"""Characters that all references to an entity may come to."""
SVG = "http://www.w3.org/2000/svg"
_PREFIXES = {
    SVG: "",
    "http://www.inkscape.org/namespaces/inkscape": "inkscape:",
    "http://www.w3.org/1999/xlink": "xlink:",
    "urn:strokeplan": "strokeplan:",
}
_WITH_TEXT = {"style", "strokeplan:settings"}
_ENCODINGS = re.compile(r"utf-?8|utf-?16([lb]e)?|us-ascii|ascii|iso-8859-\d+|latin-?1|windows-125\d|cp125\d", re.I)
"""Those in which markup is what it is in ASCII; there are others, in which limits could be got around."""


class Node:
    """An element: its name, attributes, children, line in the file, and text where a reader wants it."""

    __slots__ = ("attributes", "children", "line", "tag", "text")

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag, self.attributes, self.line = tag, attributes, line
        self.children: list[Node] = []
        self.text = ""

    def __str__(self) -> str:
        name = self.attributes.get("id")
        return f"line {self.line}, <{self.tag}{f' id={name[:60]!r}' if name else ''}>"

    def walk(self) -> Iterator[Node]:
        """This element and all within, in document order."""
        stack = [self]
        while stack:
            node = stack.pop()
            yield node
            stack += reversed(node.children)


def parse(data: bytes) -> Node:
    """The root element of a document. Raises FormatError with the line of a fault."""
    if len(data) > MAX_BYTES:
        raise FormatError(f"holds more than {MAX_BYTES >> 20} MB; that is too much for an SVG")
    if not data.strip():
        raise FormatError("is empty; give an SVG")
    if data.count(b"=") > MAX_ATTRIBUTES:
        raise FormatError(f"has more than {MAX_ATTRIBUTES:,} attributes; that is too much for an SVG")
    builder = _Builder(data)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise FormatError(f"is no sound XML: {reason}, line {error.lineno}, column {error.offset + 1}") from None
    except (LookupError, ValueError) as error:  # an encoding that is unknown here, or has more than a byte a letter
        raise FormatError(f"is no sound XML: {' '.join(str(error).split())}") from None
    return builder.top.children[0]


class _Builder:
    """expat's handlers."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.top = Node("", {}, 0)
        self.stack = [self.top]
        self.elements = 0
        self.names: dict[str, str] = {}
        self.parser = parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.XmlDeclHandler = self.declaration
        parser.EntityDeclHandler = self.entity

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.elements += 1
        if self.elements > MAX_ELEMENTS:
            raise FormatError(f"has more than {MAX_ELEMENTS:,} elements; that is too much for an SVG")
        if len(self.stack) > MAX_DEPTH:
            raise FormatError(f"line {self.parser.CurrentLineNumber}: elements are nested more than {MAX_DEPTH} deep")
        short = self.names.get(tag) or self.short(tag)
        if " " in "".join(attributes):  # a name with its namespace
            attributes = {self.names.get(name) or self.short(name): value for name, value in attributes.items()}
        node = Node(short, attributes, self.parser.CurrentLineNumber)
        self.stack[-1].children.append(node)
        self.stack.append(node)
        self.parser.CharacterDataHandler = self.characters if short in _WITH_TEXT else None

    def end(self, _: str) -> None:
        self.stack.pop()
        self.parser.CharacterDataHandler = self.characters if self.stack[-1].tag in _WITH_TEXT else None

    def characters(self, text: str) -> None:
        self.stack[-1].text += text

    def short(self, name: str) -> str:
        space, _, local = name.rpartition(" ")
        return self.names.setdefault(name, _PREFIXES[space] + local if space in _PREFIXES else name)

    def declaration(self, _: str, encoding: str | None, __: int) -> None:
        if encoding is not None and not _ENCODINGS.fullmatch(encoding):
            raise FormatError(f"is in the encoding {encoding[:40]!r}; save it as UTF-8")

    def entity(self, name: str, _: int, value: str | None, *__: str | None) -> None:
        where = f"line {self.parser.CurrentLineNumber}: the entity {name[:40]!r}"
        if value is None:
            raise FormatError(f"{where} stands for another file; nothing outside an SVG is read")
        if re.search("[<&%]", value):
            raise FormatError(f"{where} holds markup or other entities; only plain text is read")
        if len(value) * self.data.count(b"&") > MAX_ENTITY_TEXT:
            raise FormatError(f"{where} would come to more than {MAX_ENTITY_TEXT:,} characters")
