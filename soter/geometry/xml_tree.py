"""Parses untrusted XML into a small tree with line numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import AttributesImpl, Locator

import defusedxml.sax
from defusedxml.common import DefusedXmlException

from soter.errors import ConfigError
from soter.problems import Problem, config_error, cut, shown_value

_MAX_DEPTH = 8


@dataclass(slots=True)
class Element:
    """An element of a document."""

    tag: str
    line: int
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        """Return the children with a name."""
        return [child for child in self.children if child.tag == tag]


class _TreeBuilder(ContentHandler):
    """Builds the tree with line numbers, which a tree of the standard library lacks."""

    def __init__(self) -> None:
        super().__init__()
        self.root: Element | None = None
        self.problems: list[Problem] = []
        self._open: list[Element] = []
        self._locator: Locator | None = None

    def setDocumentLocator(self, locator: Locator) -> None:  # noqa: N802 - SAX names it
        self._locator = locator

    def startElement(self, name: str, attrs: AttributesImpl) -> None:  # noqa: N802 - SAX names it
        element = Element(name, self._line() or 1, dict(attrs.items()))
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        if len(self._open) >= _MAX_DEPTH:
            raise SAXException(f"elements are nested more than {_MAX_DEPTH} deep; a workspace never is")
        self._open.append(element)

    def endElement(self, name: str) -> None:  # noqa: N802 - SAX names it
        self._open.pop()

    def characters(self, content: str) -> None:
        if content.strip():
            message = f"text {shown_value(content.strip())} is not allowed here; values stand in attributes"
            self.problems.append(Problem(message, f"<{cut(self._open[-1].tag)}>", self._line()))

    def _line(self) -> int | None:
        return self._locator.getLineNumber() if self._locator is not None else None


def parse_tree(data: bytes, source: str, root: str) -> Element:
    """Return a document as a tree with line numbers.

    Raises:
        ConfigError: the document is not well-formed, declares entities, has text, or no element.
    """
    builder = _TreeBuilder()
    try:
        # A workspace needs no DTD, so none is allowed, and no entities can be declared.
        defusedxml.sax.parseString(data, builder, forbid_dtd=True)
    except SAXParseException as failure:
        message = f"not well-formed XML: {failure.getMessage()} (column {failure.getColumnNumber()})"
        raise ConfigError(message, source=source, line=failure.getLineNumber()) from failure
    except SAXException as failure:
        raise ConfigError(failure.getMessage(), source=source, line=builder._line()) from failure
    except DefusedXmlException as failure:
        raise ConfigError(
            "a document type or an entity is declared, which is refused for safety; remove the <!DOCTYPE ...>",
            source=source,
            line=builder._line(),
        ) from failure
    except (ValueError, LookupError) as failure:  # an unknown encoding, or bytes that are invalid in it
        raise ConfigError(f"cannot be decoded: {failure}; write it in UTF-8", source=source) from failure
    if builder.problems:
        raise config_error(builder.problems, source)
    if builder.root is None:
        raise ConfigError(f"there is no <{root}> in it", source=source)
    return builder.root
