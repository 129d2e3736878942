"""`armd schema NAME`: the JSON schema of one of armd's files, for an editor."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from armd.daemon.files.formats import DIALECT, FORMATS, json_schema
from armd.files.outputs import OutputKind, add_force, check_outputs
from armd.files.writing import write_whole

SCHEMA = OutputKind("a JSON schema", lambda head: DIALECT.encode() in head)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "; ".join(f"{name}: {title.split(':')[0]}" for name, (_, title) in FORMATS.items())
    parser.add_argument("name", choices=FORMATS, metavar="NAME", help=f"of which file: {words}")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE.json", help="default: standard output"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    text = json.dumps(json_schema(args.name), indent=1) + "\n"
    if args.output is None:
        print(text, end="")
        return 0
    check_outputs({"-o": (args.output, SCHEMA)}, [], args.force)
    write_whole(args.output, text)
    return 0
