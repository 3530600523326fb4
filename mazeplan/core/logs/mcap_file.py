"""Reads the messages of an MCAP file; `run_log_reader` says what the messages mean.

The file is read from front to back without its index, because a file that was cut has no index. All complete chunks
count.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, McapRecord, Message
from mcap.stream_reader import StreamReader

from mazeplan.core import file_kinds
from mazeplan.core.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
RECORD_LIMIT = 64 * 2**20  # bytes; the longest record of a run log is an attached model
EXPECTED = "a run log of mazeplan (MCAP)"
HEADER, NO_RUN = "/header", "got an MCAP file without the header of a run"
DAMAGE = (ValueError, KeyError, RecursionError)  # what damaged bytes raise
Document = tuple[str, dict[str, Any]]  # topic, message


class McapFile:
    """A file. complete: whether it was finished; valid when the whole file was read

    Every method raises LogError for a file that is missing, damaged, or not an MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path, self.complete = path, True
        self._count = 0  # messages read so far

    def documents(self) -> Iterator[Document]:
        """The messages, one after another."""
        topics: dict[int, str] = {}
        try:
            for record in self._records():
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    document = json.loads(record.data)
                    if not isinstance(document, dict):
                        raise ValueError("a message is no JSON object")
                    self._count += 1
                    yield topics[record.channel_id], document
        except DAMAGE as problem:
            if topics and HEADER not in topics.values():  # a whole file of another program, such as a bag of ROS 2
                raise LogError(f"{NO_RUN}, expected {EXPECTED}", file=self.path) from None
            raise self._damaged(problem) from None

    def attachment(self, name: str) -> bytes | None:
        """Content of a file that is attached to the log, or None."""
        try:
            for record in self._records():
                if isinstance(record, Attachment) and record.name == name:
                    return record.data
        except DAMAGE as problem:
            raise self._damaged(problem) from None
        return None

    def _records(self) -> Iterator[McapRecord]:
        """All records up to the end, or to where the file was cut."""
        try:
            with self.path.open("rb") as stream:
                size = os.fstat(stream.fileno()).st_size
                if stream.read(len(MAGIC)) != MAGIC:
                    raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path)
                stream.seek(max(len(MAGIC), size - len(MAGIC)))
                self.complete = stream.read() == MAGIC
                stream.seek(0)
                try:
                    yield from StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT).records
                except Exception as problem:  # damaged bytes may raise anything in the library of a compression
                    if self.complete or stream.tell() < size:  # a cut file ends in the midst of a record
                        raise ValueError(str(problem) or type(problem).__name__) from None
        except OSError:
            raise LogError(file_kinds.refused(self.path, EXPECTED), file=self.path) from None

    def _damaged(self, problem: Exception) -> LogError:
        why = " ".join(str(problem).split())[:120] or type(problem).__name__
        remedy = "copy it again from where it was recorded"
        return LogError(f"damaged after {self._count} messages: {why}; {remedy}", file=self.path)
