"""An XML file of a robot as a tree, read as ROS reads it: a prefix is a part of a name.

No namespace is looked up, so one that nobody declared is no error, and no entity is expanded.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from armd.errors import BadInput
from armd.files.inputs import read_input

#: What a file of a robot is called.
ROBOTS = (".urdf", ".xml", ".xacro", ".sdf")
#: No robot's description is deeper than some dozen elements.
MOST_DEEP = 200


def read_robot(path: Path, content: bytes | None = None) -> Element:
    """The `<robot>` of a URDF, or of its *content*; raises `BadInput` for what is none, by what it
    is."""
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
    """The root element of the file, or of its *content*; raises `BadInput` for what is no XML."""
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
    except (ValueError, LookupError) as error:  # of an encoding that Python does not know
        raise BadInput(path, "the file", str(error), "a URDF (XML) in UTF-8") from error
    return builder.close()
