"""Find the byte positions of a URDF's joints, so that only numbers are edited.

No parser writes a file back unchanged: comments, white space, quotation marks and the order of
attributes would be lost. An edit here replaces the text of one number, or inserts a missing
attribute or element.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from armd.errors import BadInput

#: The numbers of an attribute; None leaves one unchanged.
Numbers = Sequence[float | None]

_NAME = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE = re.compile(rb"""\s+([^\s=/>]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_END = re.compile(rb"\s*/?>")


@dataclass(frozen=True)
class Edit:
    """Replace the bytes from *start* to *end* with *text*."""

    start: int
    end: int
    text: bytes


@dataclass(frozen=True)
class StartTag:
    """The position of a start tag, from `<` to behind `>`."""

    start: int
    end: int
    last: int  # behind its last attribute, or its name
    values: dict[str, tuple[int, int]]  # of an attribute, between its quotation marks


@dataclass
class JointPlaces:
    """The positions of a robot's `<joint>` and of its child elements."""

    tag: StartTag
    children: dict[str, StartTag] = field(default_factory=dict)
    first_child: int = 0  # the offset of its `<`


def find_joints(path: Path, content: bytes) -> list[JointPlaces]:
    """Return each `<joint>` directly below the root, in the order of the file.

    Raises `BadInput` for a file in UTF-16.
    """
    if b"\0" in content:
        raise BadInput(path, "the file", "UTF-16", "a URDF in UTF-8, to edit its numbers in place")
    parser = expat.ParserCreate()
    joints: list[JointPlaces] = []
    open_elements: list[str] = []

    def start(name: str, _: dict[str, str]) -> None:
        offset = parser.CurrentByteIndex
        if len(open_elements) == 1 and name == "joint":
            joints.append(JointPlaces(_parse_start_tag(content, offset)))
        elif len(open_elements) == 2 and open_elements[1] == "joint":
            joint = joints[-1]
            joint.first_child = joint.first_child or offset
            joint.children.setdefault(name, _parse_start_tag(content, offset))
        open_elements.append(name)

    def end(_: str) -> None:
        open_elements.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.Parse(content, True)
    return joints


def _parse_start_tag(content: bytes, start: int) -> StartTag:
    name = _NAME.match(content, start)
    assert name is not None, "expat has found a start tag here"
    last, values = name.end(), {}
    while attribute := _ATTRIBUTE.match(content, last):
        group = 2 if attribute.start(2) >= 0 else 3
        values[attribute[1].decode("ascii", "replace")] = attribute.span(group)
        last = attribute.end()
    closed = _END.match(content, last)
    assert closed is not None, "expat has found the tag's end"
    return StartTag(start, closed.end(), last, values)


def replace_tag(
    content: bytes, joint: JointPlaces, tag: str, attributes: Mapping[str, Numbers]
) -> list[Edit]:
    """Return edits that set attributes of a joint's *tag*; None leaves a number unchanged.

    In a missing attribute or element, None becomes 0.
    """
    changed = {
        name: numbers
        for name, numbers in attributes.items()
        if any(number is not None for number in numbers)
    }
    element_tag = joint.children.get(tag)
    if element_tag is None:
        if not changed:
            return []
        between = content[joint.tag.end : joint.first_child]
        space = between if not between.strip() else b""
        attribute_text = "".join(map(_format_attribute, changed, changed.values()))
        element = f"<{tag}{attribute_text}/>".encode()
        return [Edit(joint.tag.end, joint.tag.end, space + element)]
    edits = []
    for name, numbers in changed.items():
        if name not in element_tag.values:
            edits.append(
                Edit(element_tag.last, element_tag.last, _format_attribute(name, numbers).encode())
            )
            continue
        first, last = element_tag.values[name]
        words = re.finditer(rb"\S+", content[first:last])
        edits += [
            Edit(first + word.start(), first + word.end(), _format_number(number).encode())
            for word, number in zip(words, numbers, strict=True)
            if number is not None
        ]
    return edits


def _format_attribute(name: str, numbers: Numbers) -> str:
    return f' {name}="{" ".join(_format_number(number or 0.0) for number in numbers)}"'


def apply_edits(content: bytes, edits: Iterable[Edit]) -> bytes:
    """Return the content with all *edits*; those at one position keep their order."""
    parts, done = [], 0
    for edit in sorted(edits, key=lambda edit: edit.start):
        parts += [content[done : edit.start], edit.text]
        done = edit.end
    return b"".join([*parts, content[done:]])


def _format_number(value: float) -> str:
    return repr(float(value) + 0.0)
