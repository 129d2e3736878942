"""A part of a result: a dict whose keys are also attributes, like scipy's `OptimizeResult`."""

from __future__ import annotations

from typing import Any


class Record(dict[str, Any]):
    """Plain data; `record.name` is `record["name"]`, also in the dicts and lists within it."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no {name!r} among {', '.join(self)}") from None

    def __dir__(self) -> list[str]:
        return [*self, *super().__dir__()]


def make_records(value: Any) -> Any:
    """Return plain data with a `Record` for each dict."""
    if isinstance(value, dict):
        return Record({key: make_records(below) for key, below in value.items()})
    if isinstance(value, list):
        return [make_records(below) for below in value]
    return value
