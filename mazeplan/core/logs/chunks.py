"""Reads the messages of an MCAP file, chunk by chunk; `run_log_reader` says what the messages mean.

The file is read from front to back without its index, because a file that was cut has no index. All complete chunks
count. Logs of older versions have no chunks; in them, each message counts as a chunk.

The reader of the package `mcap` makes an object of each record, half a million for an hour of a run. This reader takes
out only the messages that are asked for, and decodes a message only when it is needed.
"""

from __future__ import annotations

import json
import os
import shlex
import struct
import zlib
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd
from mcap.stream_reader import get_chunk_data_stream

from mazeplan.core import file_kinds
from mazeplan.core.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT = 64 * 2**20  # bytes; the longest record of a run log is an attached model
EXPECTED = "a run log of mazeplan (MCAP)"
HEADER, NO_RUN = "/header", "got an MCAP file without the header of a run"
HEAD = struct.Struct("<BQ")  # of a record: operation code, length
MESSAGE = struct.Struct("<HIQQ")  # of a message: channel, sequence, log time, publish time
DAMAGE = (McapError, ValueError, KeyError, RecursionError, struct.error)  # what damaged bytes raise
Record = tuple[int, int, bytes]  # place in the file, operation code, content
Document = tuple[str, dict[str, Any]]  # topic, message


class Encoded(NamedTuple):
    """A message as it is in the file. ns: its log time; data: JSON."""

    topic: str
    ns: int
    data: bytes


class Chunks:
    """The chunks of a file, one after another: place in the file, messages.

    complete: whether the file was finished; valid when the whole file was read

    Every method raises LogError for a file that is missing, damaged, or not an MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._topics: dict[int, str] = {}
        self._before, self._whole = 0, 0  # messages of earlier chunks, and bytes up to the last one
        self.complete = True

    def __iter__(self) -> Iterator[tuple[int, list[Encoded]]]:
        try:
            for place, opcode, content in self._records():
                if found := self._messages(opcode, content):
                    yield place, found
                    self._before, self._whole = self._before + len(found), place + HEAD.size + len(content)
        except DAMAGE as problem:
            raise self._damaged(_one_line(problem)) from None

    def at(self, place: int) -> list[Encoded]:
        """The messages of a chunk that was read before."""
        try:
            with self.path.open("rb") as stream:
                stream.seek(place)
                opcode, length = HEAD.unpack(stream.read(HEAD.size))
                return self._messages(opcode, stream.read(min(length, RECORD_LIMIT)))
        except (OSError, *DAMAGE) as problem:
            raise LogError(f"was changed: {_one_line(problem)}", file=self.path) from None

    def documents(self, messages: Sequence[Encoded]) -> list[Document]:
        """Decode messages."""
        found: list[Document] = []
        try:
            for topic, _, data in messages:
                found.append((topic, _document(data)))
        except DAMAGE as problem:
            if HEADER not in self._topics.values():  # a whole file of another program, such as a bag of ROS 2
                raise LogError(f"{NO_RUN}, expected {EXPECTED}", file=self.path) from None
            raise self._damaged(_one_line(problem), len(found)) from None
        return found

    def attachment(self, name: str) -> bytes | None:
        """Content of a file that is attached to the log, or None."""
        try:
            for _, opcode, content in self._records():
                if opcode == Opcode.ATTACHMENT and (kept := Attachment.read(_stream(content))).name == name:
                    return kept.data
        except DAMAGE as problem:
            raise self._damaged(_one_line(problem)) from None
        return None

    def _damaged(self, problem: str, more: int = 0) -> LogError:
        """The error, with a remedy. more: number of messages that were read from the damaged chunk."""
        remedy = "copy it again from where it was recorded"
        if self._before:
            kept = shlex.quote(f"{self.path.stem}-kept{self.path.suffix}")
            remedy += f", or keep what is whole: head -c {self._whole} {shlex.quote(str(self.path))} > {kept}"
        return LogError(f"damaged after {self._before + more} messages: {problem}; {remedy}", file=self.path)

    def _records(self) -> Iterator[Record]:
        """All records up to the end, or to where the file was cut."""
        try:
            with self.path.open("rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                if stream.read(len(MAGIC)) != MAGIC:
                    raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path)
                stream.seek(max(len(MAGIC), size - len(MAGIC)))
                finished = stream.read() == MAGIC
                stream.seek(len(MAGIC))
                self.complete = yield from _walk(stream, size)
        except OSError:
            raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path) from None
        if finished and not self.complete:  # the end of the file is there, so a length in the middle is wrong
            raise self._damaged("a record is longer than the file")

    def _messages(self, opcode: int, content: bytes) -> list[Encoded]:
        """The messages in a record. Raises one of DAMAGE."""
        found: list[Encoded] = []
        if opcode == Opcode.CHUNK:
            data, at = _unpacked(content), 0
            while at < len(data):
                inner, length = HEAD.unpack_from(data, at)
                begin, at = at + HEAD.size, at + HEAD.size + length
                if at > len(data):
                    raise ValueError("a message is longer than its chunk")
                self._take(inner, data, begin, at, found)
        else:
            self._take(opcode, content, 0, len(content), found)
        return found

    def _take(self, opcode: int, data: bytes, begin: int, end: int, found: list[Encoded]) -> None:
        """Take one record of data: add a message to `found`, or a channel to the known topics."""
        if opcode == Opcode.MESSAGE:
            channel, _, ns, _ = MESSAGE.unpack_from(data, begin)
            found.append(Encoded(self._topics[channel], ns, data[begin + MESSAGE.size : end]))
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(data[begin:end]))
            self._topics[channel.id] = channel.topic


def _walk(stream: IO[bytes], size: int) -> Iterator[Record]:
    """The records after the first magic bytes; returns whether the file is finished. Raises one of DAMAGE for a record
    that is too long, or a wrong checksum. size: of the file, bytes."""
    at, opcode, checksum = len(MAGIC), 0, zlib.crc32(MAGIC)
    while opcode != Opcode.FOOTER:
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            return False
        opcode, length = HEAD.unpack(head)
        if length > RECORD_LIMIT:
            raise RecordLengthLimitExceeded(opcode, length, RECORD_LIMIT)
        if at + HEAD.size + length > size or len(content := stream.read(length)) < length:
            return False
        if opcode == Opcode.DATA_END and DataEnd.read(_stream(content)).data_section_crc not in (0, checksum):
            raise ValueError("the checksum of all is wrong")
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))
        yield at, opcode, content
        at += HEAD.size + length
    end = stream.read(len(MAGIC))
    if len(end) == len(MAGIC) and end != MAGIC:
        raise ValueError("no end behind the index")
    return end == MAGIC


def _unpacked(content: bytes) -> bytes:
    """The messages in a chunk, as bytes. Raises ValueError for a chunk that is damaged."""
    chunk = Chunk.read(_stream(content))
    if chunk.uncompressed_size > RECORD_LIMIT:
        raise ValueError("a chunk that is too long")
    try:
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    except Exception as problem:  # from the compression library that the file asks for
        raise ValueError(f"a chunk cannot be unpacked: {_one_line(problem)}") from None
    return stream.read(length)


def _stream(content: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(content))


def _document(data: bytes) -> dict[str, Any]:
    document = json.loads(data)
    if not isinstance(document, dict):
        raise ValueError("a message is no JSON object")
    return document


def _one_line(problem: Exception) -> str:
    return " ".join(str(problem).split())[:120] or type(problem).__name__
