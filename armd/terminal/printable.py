"""Text from devices and networks, made fit for a person's terminal."""

from __future__ import annotations

import unicodedata

#: Control characters, those that turn the writing direction, and halves of characters.
_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")


def printable(text: object) -> str:
    """*text* on one line, without anything that a terminal obeys: `\\x1b[2J` is shown, not done."""
    said = str(text)
    if said.isprintable():
        return said
    return "".join(_shown(letter) for letter in said)


def _shown(letter: str) -> str:
    if unicodedata.category(letter) not in _CATEGORIES:
        return letter
    return letter.encode("unicode_escape").decode()
