"""Sphinx: the site of `make docs`, from README.md, docs/, the notebooks and the docstrings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import armd

ROOT = Path(__file__).parents[2]
#: Where `make notebooks` leaves the notebooks with their outputs.
EXECUTED = ROOT / "out" / "notebooks"

REAL_DATA = "tests/real/data/README"
TOCTREE = """
```{{toctree}}
:hidden:
:caption: {}

{}
```
"""
#: Classes that a caller makes; the others come from functions, by arguments that are not public.
MADE_BY_CALLERS = {"armd.Model", "armd.Corrector"}

project = "armd"
author = "The armd project"
version = release = armd.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc"]
root_doc = "README"
include_patterns = ["*.md", "docs/**", f"{REAL_DATA}.md"]
exclude_patterns = ["docs/site", "docs/firmware", "docs/examples"]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
html_theme = "furo"
html_title = f"armd {release}"
html_copy_source = False

myst_heading_anchors = 4
nb_execution_mode = "off"  # they come with their outputs
nb_merge_streams = True

nitpicky = True
#: What is annotated with names of other projects, whose sites nobody asks.
nitpick_ignore_regex = [
    ("py:.*", r"(?:np|npt|numpy|pa|pyarrow|pathlib|os|datetime|collections|matplotlib|zenoh)\..*"),
    ("py:.*", r"(?:Any|Path|Self|Sequence|Mapping|Iterable|Iterator|AsyncIterator|Callable)"),
    ("py:.*", r"(?:Axes|Figure)"),
]
autodoc_default_options = {"members": True, "inherited-members": False}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
default_role = "code"


def append_contents(app: Sphinx, docname: str, source: list[str]) -> None:
    """Give the front page its contents: the tables of docs/README.md, section by section."""
    if docname != root_doc:
        return
    for section in re.split(r"^## ", (ROOT / "docs/README.md").read_text("utf-8"), flags=re.M)[1:]:
        title = section.partition("\n")[0]
        pages = re.findall(r"\]\(([\w./-]+\.(?:md|ipynb|rst))\)", section)
        listed = "\n".join(f"docs/{page}" for page in dict.fromkeys(pages))
        source[0] += TOCTREE.format(title, listed)
    others = sorted({path.stem for path in ROOT.glob("*.md")} - {root_doc})
    source[0] += TOCTREE.format("Project", "\n".join(["docs/README", *others, REAL_DATA]))


def list_decisions(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the records below the index of decisions."""
    if docname == "docs/decisions/README":
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n0*\n```\n"


def unlink_folders(app: Sphinx, docname: str, source: list[str]) -> None:
    """Name a folder of the project without a link: a site has no page for it."""

    def name(link: re.Match[str]) -> str:
        return f"`{link[2]}`" if ((ROOT / docname).parent / link[2]).is_dir() else link[0]

    source[0] = re.sub(r"\[([^\]]+)\]\(([\w./-]+)\)", name, source[0])


def take_executed(app: Sphinx, docname: str, source: list[str]) -> None:
    """Show a notebook with the outputs that it had when it ran."""
    executed = EXECUTED / f"{Path(docname).name}.ipynb"
    if docname.startswith("docs/notebooks/") and executed.exists():
        source[0] = executed.read_text("utf-8")


def skip_internal(
    app: Sphinx, what: str, name: str, member: object, skip: bool, options: object
) -> bool | None:
    """Leave out what says of itself that it is not public."""
    return True if "not public" in (getattr(member, "__doc__", "") or "").lower() else None


def link_public_names(
    app: Sphinx, what: str, name: str, member: object, options: object, lines: list[str]
) -> None:
    """Link `armd.NAME` of a docstring where it is public."""

    def link(found: re.Match[str]) -> str:
        return f":py:obj:{found[0]}" if found[1] in armd.__all__ else found[0]

    lines[:] = [re.sub(r"`armd\.(\w+)`", link, line) for line in lines]


def hide_arguments(
    app: Sphinx, what: str, name: str, member: object, options: object, *signature: str | None
) -> tuple[str, None] | None:
    """Show no arguments of a class that a function of armd makes."""
    made_inside = what == "class" and name not in MADE_BY_CALLERS
    return ("", None) if made_inside and signature[0] is not None else None


def resolve_public_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, contnode: nodes.TextElement
) -> nodes.Element | None:
    """Link a class by its public name, `armd.Session`, wherever it is defined."""
    name = node["reftarget"].rpartition(".")[2]
    if node.get("refdomain") != "py" or name not in armd.__all__:
        return None
    domain: Any = env.get_domain("py")
    for role in ("class", "func", "exc", "data", "mod"):
        found: nodes.Element | None = domain.resolve_xref(
            env, node["refdoc"], app.builder, role, f"armd.{name}", node, contnode
        )
        if found is not None:
            return found
    return None


def setup(app: Sphinx) -> None:
    """Connect the functions above."""
    for change in (append_contents, list_decisions, unlink_folders, take_executed):
        app.connect("source-read", change)
    app.connect("autodoc-skip-member", skip_internal)
    app.connect("autodoc-process-docstring", link_public_names)
    app.connect("autodoc-process-signature", hide_arguments)
    app.connect("missing-reference", resolve_public_name)
