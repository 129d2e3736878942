"""Reads an MCAP file record by record, and checks every checksum and length.

The mcap library reads such files too, but it stops at the first damage, and it unpacks a chunk of
any stated size: 100 kB can state 3 GB.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer

from armd.errors import BadInput
from armd.files.inputs import open_input

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
#: armd writes chunks of 64 kB plus a message; its largest attachment is a calibration.
MOST_BYTES = 16 << 20
PRIVATE = 0x80  # opcodes from here on belong to other programs


@dataclass(frozen=True, slots=True)
class Recorded:
    """One message of a recording."""

    topic: str
    data: bytes
    unix_ns: int


class McapFile:
    """An MCAP file. After `parts` was iterated to its end, the file is complete, or `cut` is set.

    Raises `BadInput` where it is damaged: a wrong checksum, an impossible length, or bytes that are
    no record.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.cut: int | None = None  # the byte after its last complete record, if it has no end
        self.only_index_cut = False  # no message is missing
        self._names: dict[int, str] = {}
        self._offset = 0  # position of the record being read

    def parts(self) -> Iterator[Attachment | bytes]:
        """Yield attachments, and the records of each chunk, unpacked."""
        with open_input(self.path) as file:
            size = os.fstat(file.fileno()).st_size
            if file.read(len(MAGIC)) != MAGIC:
                raise BadInput(self.path, "the file", "no magic of MCAP", "a recording (.mcap)")
            file.seek(max(0, size - len(MAGIC)))
            ended = file.read() == MAGIC
            file.seek(len(MAGIC))
            yield from self._records(file, size, ended)

    def messages(self) -> Iterator[Recorded]:
        """Yield all messages, in the order of the file."""
        for part in self.parts():
            if isinstance(part, bytes):
                yield from self._unpacked(part)

    def _records(self, file: BinaryIO, size: int, ended: bool) -> Iterator[Attachment | bytes]:
        data_crc, summary_crc, in_summary = zlib.crc32(MAGIC), 0, False
        while True:
            self._offset = file.tell()
            head = file.read(HEAD.size)
            remaining = size - self._offset - HEAD.size
            if remaining < 0 or HEAD.unpack(head)[1] > remaining:
                if ended:
                    raise self._damaged("a record that would go on beyond the file")
                self.cut, self.only_index_cut = self._offset, in_summary
                return
            opcode, length = HEAD.unpack(head)
            if length > MOST_BYTES and opcode != Opcode.CHUNK_INDEX:
                raise self._damaged(f"a record of {length} bytes", f"{MOST_BYTES} at most")
            content = file.read(length)
            if opcode == Opcode.FOOTER:
                self._end(file, size, head + content, summary_crc)
                return
            if opcode == Opcode.DATA_END:
                stated = int.from_bytes(content[:4], "little")
                if stated not in (0, data_crc) or length != 4:
                    raise self._damaged("a checksum of all data that does not hold")
                in_summary = True
            elif in_summary:
                summary_crc = zlib.crc32(head + content, summary_crc)
            else:
                data_crc = zlib.crc32(content, zlib.crc32(head, data_crc))
                part = self._part(opcode, content)
                if part is not None:
                    yield part

    def _part(self, opcode: int, content: bytes) -> Attachment | bytes | None:
        if not (0 < opcode <= Opcode.DATA_END or opcode >= PRIVATE):
            raise self._damaged(f"a record of kind {opcode}", "one of MCAP's")
        try:
            if opcode == Opcode.CHUNK:
                return self._unpack(Chunk.read(ReadDataStream(BytesIO(content))))
            if opcode == Opcode.ATTACHMENT:
                stated = int.from_bytes(content[-4:], "little")
                if stated not in (0, zlib.crc32(content[:-4])):
                    raise self._damaged("an attachment whose checksum does not hold")
                return Attachment.read(ReadDataStream(BytesIO(content)))
        except BadInput:
            raise
        except Exception as error:  # an impossible length within it, invalid text, …
            raise self._damaged(f"a record that makes no sense ({error!r})") from error
        return None

    def _unpack(self, chunk: Chunk) -> bytes:
        data = chunk.data
        if chunk.compression == "zstd":
            stated_size = zstandard.get_frame_parameters(data).content_size
            if max(stated_size, chunk.uncompressed_size) > MOST_BYTES:
                raise self._damaged("a chunk that would fill the memory", f"{MOST_BYTES} bytes")
            data = zstandard.ZstdDecompressor().decompress(data, chunk.uncompressed_size)
        elif chunk.compression:
            raise self._damaged(f"compression {chunk.compression!r}", "zstd")
        is_complete = len(data) == chunk.uncompressed_size
        if not is_complete or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise self._damaged("a chunk whose checksum does not hold")
        return bytes(data)

    def _unpacked(self, data: bytes) -> Iterator[Recorded]:
        offset = 0
        while offset < len(data):
            if offset + HEAD.size > len(data):
                raise self._damaged("a chunk that ends within a record")
            opcode, length = HEAD.unpack_from(data, offset)
            offset += HEAD.size
            content = data[offset : offset + length]
            offset += length
            if len(content) < length or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
                raise self._damaged("a chunk that ends within a record")
            if opcode == Opcode.CHANNEL:
                try:
                    channel = Channel.read(ReadDataStream(BytesIO(content)))
                except Exception as error:
                    raise self._damaged(f"a channel that makes no sense ({error!r})") from error
                self._names[channel.id] = channel.topic
            elif opcode == Opcode.MESSAGE:
                number, _, unix_ns, _ = _MESSAGE.unpack_from(content)
                if number not in self._names:
                    raise self._damaged(f"a message of channel {number}", "one that is declared")
                yield Recorded(self._names[number], content[_MESSAGE.size :], unix_ns)

    def _end(self, file: BinaryIO, size: int, footer: bytes, summary_crc: int) -> None:
        """Check the last record: the summary's checksum includes its own beginning."""
        try:
            stated = Footer.read(ReadDataStream(BytesIO(footer[HEAD.size :]))).summary_crc
        except Exception as error:
            raise self._damaged("an end that makes no sense") from error
        if stated not in (0, zlib.crc32(footer[:-4], summary_crc)):
            raise self._damaged("a checksum of the index that does not hold")
        if file.read() != MAGIC or file.tell() != size:
            raise self._damaged("something else than MCAP's magic at its end")

    def _damaged(self, actual: str, expected: str = "an undamaged recording") -> BadInput:
        return BadInput(self.path, f"byte {self._offset}", actual, expected)
