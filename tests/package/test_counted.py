"""Numbers with their nouns."""

from armd.terminal.counted import format_count


def test_one_of_something_has_no_s() -> None:
    said = [format_count(n, "reading") for n in (0, 1, 2)]
    assert said == ["0 readings", "1 reading", "2 readings"]
