"""Stores the geometry of an arm's servos between connections, in the state folder.

`servos-SERIAL.json` holds the `accepted` values and the last `found` ones, by servo id. A servo
that was never there before is accepted as it is. So is a property that an older armd did not read.
Later, only `armd accept` changes that.
"""

from __future__ import annotations

import json
from typing import Any, Literal
from urllib.parse import quote

from pydantic import Field

from armd.drivers.poll.protocol.family import Family, Servo, list_differences
from armd.errors import BadInput
from armd.files.schema import Strict, load_json
from armd.files.state_folder import find_state_folder
from armd.files.writing import write_whole

Geometries = dict[int, dict[str, Any]]  # by servo id, as `Servo.geometry`


class _File(Strict):
    schema_: Literal["armd.servos/1"] = Field(default="armd.servos/1", alias="schema")
    serial_number: str
    accepted: Geometries = {}
    last_found: Geometries = Field(default={}, alias="found")


class Memory:
    """The stored servos of one arm; it reads its file at each call, as others may change it."""

    def __init__(self, serial_number: str, family: Family) -> None:
        self._serial_number = serial_number
        self._family = family
        self.path = find_state_folder() / f"servos-{quote(serial_number, safe=' ')}.json"

    def compare(self, servos: dict[int, Servo], accept: bool) -> dict[int, list[str]]:
        """Compare *servos* with the accepted ones; return the differences by servo id, as phrases.

        The found values are stored, with *accept* also as the accepted ones. Raises `BadInput` for
        a damaged file, `OSError` where nothing can be stored.
        """
        before = self._load()
        reported = {servo: identified.geometry for servo, identified in servos.items()}
        completed = {
            s: reported.get(s, {}) | identified for s, identified in before.accepted.items()
        }
        accepted = completed | reported if accept else reported | completed
        after = before.model_copy(
            update={"accepted": accepted, "last_found": before.last_found | reported}
        )
        if after != before:
            self._save(after)
        changed = {
            servo: list_differences(identified, accepted[servo], self._family)
            for servo, identified in servos.items()
        }
        return {servo: phrases for servo, phrases in changed.items() if phrases}

    def accept(self) -> dict[int, list[str]]:
        """Accept the values that were found last; return the changes.

        Raises `BadInput` if no connection has left anything to accept.
        """
        before = self._load()
        if not before.last_found:
            raise BadInput(
                self.path, "found", "no servo", "those of a connection: `armd run` writes them"
            )
        self._save(before.model_copy(update={"accepted": before.accepted | before.last_found}))
        return {
            servo: [
                f"{name.replace('_', ' ')} {reported[name]}, before {accepted[name]}"
                for name in reported
                if reported[name] != accepted.get(name, reported[name])
            ]
            for servo, reported in sorted(before.last_found.items())
            for accepted in [before.accepted.get(servo, reported)]
            if accepted != reported
        }

    def changed_ns(self) -> int:
        """Return when the file was last written; 0: never."""
        try:
            return self.path.stat().st_mtime_ns
        except OSError:
            return 0

    def _load(self) -> _File:
        if not self.path.exists():
            return _File(serial_number=self._serial_number)
        return load_json(self.path, _File)

    def _save(self, content: _File) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(content.model_dump(mode="json", by_alias=True), indent=1)
        write_whole(self.path, text + "\n")
