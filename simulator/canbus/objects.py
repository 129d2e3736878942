"""A node's object dictionary: values of its EDS, written values, measured values."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources.abc import Traversable
from typing import Any

import canopen
from canopen.objectdictionary import NUMBER_TYPES
from canopen.sdo import SdoAbortedError

NO_OBJECT, NO_SUB_INDEX, READ_ONLY = 0x06020000, 0x06090011, 0x06010002
WRONG_LENGTH, WRONG_STATE = 0x06070010, 0x08000022


class Objects:
    """Answers the `canopen` library's SDO server, which calls `get_data` and `set_data`.

    *measured* (index, sub-index) gives an object's present value, or None where it only stores;
    *before_write* may refuse by `SdoAbortedError`.
    """

    def __init__(
        self,
        eds: Traversable,
        node_id: int,
        measured: Callable[[int, int], int | None],
        before_write: Callable[[int, int], None],
    ) -> None:
        self.object_dictionary: Any = canopen.import_od(str(eds), node_id)
        self._measured = measured
        self._before_write = before_write
        self._written: dict[tuple[int, int], bytes] = {}

    def factory_settings(self) -> None:
        """Forget all written values."""
        self._written.clear()

    def number(self, index: int, sub_index: int) -> int:
        """Return an unsigned object."""
        return int.from_bytes(self.get_data(index, sub_index), "little")

    def get_data(self, index: int, sub_index: int, check_readable: bool = False) -> bytes:
        variable = self._find(index, sub_index)
        value = self._measured(index, sub_index)
        if value is None:
            if (index, sub_index) in self._written:
                return self._written[index, sub_index]
            value = variable.default if variable.value is None else variable.value
        data: bytes = variable.encode_raw(value)
        return data

    def set_data(
        self, index: int, sub_index: int, data: bytes, check_writable: bool = False
    ) -> None:
        variable = self._find(index, sub_index)
        if not variable.writable:
            raise SdoAbortedError(READ_ONLY)
        if variable.data_type in NUMBER_TYPES and 8 * len(data) != len(variable):
            raise SdoAbortedError(WRONG_LENGTH)
        self._before_write(index, sub_index)
        self._written[index, sub_index] = bytes(data)

    def _find(self, index: int, sub_index: int) -> Any:
        entry = self.object_dictionary.get(index)
        if entry is None:
            raise SdoAbortedError(NO_OBJECT)
        if isinstance(entry, canopen.objectdictionary.ODVariable):
            if sub_index == 0:
                return entry
        elif sub_index in entry:
            return entry[sub_index]
        raise SdoAbortedError(NO_SUB_INDEX)
