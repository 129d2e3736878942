"""Text from devices and networks, made fit for a person's terminal."""

from __future__ import annotations

import unicodedata

#: Control characters, those that turn the writing direction, and halves of characters.
_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")


def to_printable(text: object) -> str:
    """*text* on one line, without anything that a terminal obeys: `\\x1b[2J` is shown, not done."""
    content = str(text)
    if content.isprintable():
        return content
    return "".join(_escape_letter(letter) for letter in content)


#: What turns the direction of the writing round, beside single marks within a word.
_TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
_LINES = frozenset("\n\r\t")


def escape_invisible(text: str) -> str:
    """The first character, as an escape, that a terminal obeys or that turns the writing round; or
    nothing. Lines and tabs are none, nor marks that words of some languages have."""
    if text.isprintable():
        return ""
    for letter in text:
        bad = unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp") and letter not in _LINES
        if bad or letter in _TURNING:
            return _escape_letter(letter)
    return ""


def _escape_letter(letter: str) -> str:
    if unicodedata.category(letter) not in _CATEGORIES:
        return letter
    return letter.encode("unicode_escape").decode()
