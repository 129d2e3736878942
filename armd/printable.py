"""Makes text from devices and networks safe to print on a terminal."""

from __future__ import annotations

import unicodedata

#: Control characters, marks of writing direction, and lone surrogates.
_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")


def to_printable(text: object) -> str:
    r"""Return *text* on one line, with control characters escaped: `\x1b[2J` is shown."""
    content = str(text)
    if content.isprintable():
        return content
    return "".join(_escape_letter(letter) for letter in content)


#: Marks that change the writing direction, other than single marks within a word.
_TURNING = frozenset("\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
_LINES = frozenset("\n\r\t")


def escape_invisible(text: str) -> str:
    """Return the first unsafe character of *text*, escaped; empty if there is none.

    Unsafe are control characters and marks of writing direction. Safe are line ends and tabs, and
    marks that words of some languages need.
    """
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
