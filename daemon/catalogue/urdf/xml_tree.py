"""Read a robot's XML file as a tree like ROS does: a prefix is part of a name.

Namespaces are not looked up, so an undeclared one is not an error. Entities are refused.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from armd.errors import BadInput
from armd.files.inputs import read_input

#: Suffixes of a robot's files.
ROBOTS = (".urdf", ".xml", ".xacro", ".sdf")
#: Limit of the depth; a robot's description has at most some dozen levels.
MOST_DEEP = 200


def read_robot(path: Path, content: bytes | None = None) -> Element:
    """Return the `<robot>` of a URDF, or of its *content*.

    Raises `BadInput` for another format, and names it.
    """
    root = read_xml(path, content)
    if path.suffix.lower() == ".xacro" or any(_is_xacro(element) for element in root.iter()):
        urdf_name = path.name.removesuffix(".xacro").removesuffix(".urdf") + ".urdf"
        expected = (
            f"a URDF: expand it first, `xacro {path.name} > {urdf_name}`, and import {urdf_name}"
        )
        raise BadInput(path, "the file", "a xacro, from which a URDF is made", expected)
    if root.tag in ("mujoco", "mujocoinclude"):
        expected = "the same robot's URDF"
        raise BadInput(path, "the file", "MuJoCo's format (MJCF)", expected)
    if root.tag == "sdf":
        raise BadInput(path, "the file", "Gazebo's format (SDF)", "the same robot's URDF")
    if root.tag != "robot":
        raise BadInput(path, "the file", f"XML that begins with <{root.tag}>", "a URDF's <robot>")
    return root


def _is_xacro(element: Element) -> bool:
    return element.tag.startswith("xacro:") or any(
        "${" in value for value in element.attrib.values()
    )


def read_xml(path: Path, content: bytes | None = None) -> Element:
    """Return the root element of the file, or of its *content*; raises `BadInput`."""
    content = read_input(path) if content is None else content
    builder = TreeBuilder()
    parser = expat.ParserCreate()
    depth = 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEEP:
            location = f"line {parser.CurrentLineNumber}"
            raise BadInput(
                path, location, f"{depth} elements in each other", f"{MOST_DEEP} at most"
            )
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    def refuse_entity(name: str, *_: object) -> None:
        raise BadInput(path, f"line {parser.CurrentLineNumber}", f"the entity {name}", "none")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise BadInput(path, "the file", str(error), "a URDF (XML)") from error
    except (ValueError, LookupError) as error:  # an encoding that Python does not know
        raise BadInput(path, "the file", str(error), "a URDF (XML) in UTF-8") from error
    return builder.close()
