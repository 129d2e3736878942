"""Damage sound input as people and attackers do: by byte, by token, by line."""

from __future__ import annotations

import random
import re

#: What stands where a number, a word or a value was.
NASTY = [
    b"", b"nan", b"NaN", b"inf", b"-Infinity", b"1e999", b"-1e999", b"1e308", b"-1e-320", b"-1",
    b"0", b"-0.0", b"1" * 5000, b"0x" + b"f" * 5000, b"1e", b"--1", b"1_0", b"true", b"null", b"[]",
    b"{}", b'""', b"[[[[]]]]", b"9" * 20, b"18446744073709551616", b"\xff\xfe", b"\x00",
    b"\x1b]0;x\x07",
    "\u202egnp".encode(), "−7,25".encode(), b"#N/A", b"../../etc/passwd", b"a" * 3000, b"[" * 3000,
    b'{"a":' * 3000, b"%s%n", b"2026-02-30T25:61:00Z", b"1,5", b"deg", b"B1", b"\r\n", b"'", b'"',
    b"\\ud800", b"\\u001b[2J", b"[/x]", b"[red]", b"${HOME}", b"9223372036854775807",
]  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][\w.]*")


def damage(data: bytes, rng: random.Random) -> bytes:
    """One to four kinds of damage, one after another; at most about a megabyte."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        data = rng.choice(_KINDS)(data, rng)
    return data[: 1 << 20]


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if changed else 0):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _cut(data: bytes, rng: random.Random) -> bytes:
    first, last = sorted((rng.randint(0, len(data)), rng.randint(0, len(data))))
    return data[:first] + data[last:] if rng.random() < 0.7 else data[:first]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    first = rng.randint(0, len(data))
    last = min(len(data), first + rng.choice((1, 8, 100, 2000)))
    return data[:last] + data[first:last] * rng.choice((1, 1, 2, 50)) + data[last:]


def _insert(data: bytes, rng: random.Random) -> bytes:
    at = rng.randint(0, len(data))
    return data[:at] + rng.choice(NASTY) + data[at:]


def _replace(pattern: re.Pattern[bytes]) -> object:
    def replace(data: bytes, rng: random.Random) -> bytes:
        matches = list(pattern.finditer(data[: 1 << 16]))
        for match in sorted(rng.sample(matches, min(len(matches), rng.choice((1, 1, 2, 5)))),
                            key=lambda match: -match.start()):  # fmt: skip
            new = rng.choice(NASTY)
            if rng.random() < 0.3:  # another of the same file
                new = rng.choice(matches)[0]
            data = data[: match.start()] + new + data[match.end() :]
        return data

    return replace


def _lines(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case _:
            rng.shuffle(lines)
    return b"".join(lines)


_KINDS = [
    _flip, _cut, _repeat, _insert, _lines, _replace(_NUMBER), _replace(_NUMBER), _replace(_WORD),
]  # fmt: skip
