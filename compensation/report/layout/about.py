"""The file `about.toml`: entries of a report's head that no measurement contains."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from armd.errors import BadInput
from armd.files.schema import Strict, load_toml

#: Longer entries would push the results off the first page.
HeadLine = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=120)]


class About(Strict):
    """The content of an about.toml; an entry that is missing is a line to be filled by hand."""

    schema_: Literal["armd.about/1"] = Field(default="armd.about/1", alias="schema")
    document: HeadLine | None = None
    customer: HeadLine | None = None
    laboratory: HeadLine | None = None
    place: HeadLine | None = None
    operator: HeadLine | None = None


def load_about(path: str | Path) -> About:
    """Read and check an about.toml; raises `BadInput` naming file, key, found and expected."""
    return load_toml(path, About)


def add_about(parser: argparse.ArgumentParser) -> None:
    """Add the option --about, for reports that are signed."""
    parser.add_argument(
        "--about",
        metavar="ABOUT.toml",
        help="document, customer, laboratory, place and operator for the head of the report",
    )


def read_about(args: argparse.Namespace) -> About:
    """Read the file of --about; raises `BadInput` for a bad file, or if no report is asked for."""
    if args.about is None:
        return About()
    about = load_about(args.about)
    if not (args.report or args.pdf):
        raise BadInput("the command line", "--about", "no report", "--report or --pdf beside it")
    return about
