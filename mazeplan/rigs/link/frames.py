"""Frames of the line protocol of docs/protocol.md. On the board, tools/firmware/frame.c reads and writes them.

    $T,17,123450,32768,32760,15000,15000,0,0,0*B6DC\\n

'$', a body of at most 64 printable characters, '*', the CRC-16 of the body in four upper-case hexadecimal digits,
newline. This module opens no port and reads no clock.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass

MOST_BODY = 64  # characters
U16, U32 = 1 << 16, 1 << 32
BEGIN, SUM, END, HEX = b"$"[0], b"*"[0], b"\n"[0], b"0123456789ABCDEF"


@dataclass(frozen=True)
class Frame:
    """A frame with a correct checksum.

    kind: its letter.
    fields: the fields after the letter."""

    kind: str
    fields: tuple[str, ...]

    def numbers(self, count: int, *, first: int = 0) -> tuple[int, ...]:
        """`count` fields, from number `first` on, as whole numbers. Raises ValueError if they are not numbers."""
        fields = self.fields[first : first + count]
        if len(fields) != count or not all(
            field.isascii() and field.isdigit() and len(field) <= 10 for field in fields
        ):
            raise ValueError(f"got {','.join((self.kind, *self.fields))!r}, expected {count} numbers")
        return tuple(int(field) for field in fields)


def crc16(body: bytes | bytearray) -> int:
    """CRC-16 with polynomial 0x1021, initial value 0xFFFF."""
    return binascii.crc_hqx(body, 0xFFFF)


def encode(kind: str, *fields: int | str) -> bytes:
    """A frame as bytes. Raises ValueError for fields that no frame can hold."""
    body = ",".join((kind, *map(str, fields)))
    if len(body) > MOST_BODY or not body.isascii() or not body.isprintable() or {"$", "*"} & set(body):
        raise ValueError(f"got {body!r}, expected up to {MOST_BODY} printable characters, without $ and *")
    return b"$%s*%04X\n" % (body.encode(), crc16(body.encode()))


class FrameReader:
    """Converts bytes, in pieces of any size, to frames. After noise the reader continues at the next '$'.

    bad: number of damaged frames. Bytes outside frames do not count."""

    def __init__(self) -> None:
        self.bad = 0
        self._rest = bytearray()  # empty, or a '$' and the bytes of its frame so far

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes, and return the frames that they complete."""
        found = []
        self._rest += data
        while True:
            begin = self._rest.find(BEGIN)
            if begin < 0:
                self._rest.clear()
                return found
            del self._rest[:begin]
            length, complete = _look(self._rest)
            if length == 0:
                return found
            body = bytes(self._rest[1 : length - 6])
            del self._rest[:length]
            if complete:
                kind, *fields = body.decode("ascii").split(",")
                found.append(Frame(kind, tuple(fields)))
            else:
                self.bad += 1


def _look(data: bytearray) -> tuple[int, bool]:
    """Number of bytes to remove from the start, and whether they are a good frame.

    (0, False): the frame is incomplete so far."""
    for at in range(1, len(data)):
        byte = data[at]
        if byte == BEGIN:
            return at, False
        if byte == SUM:
            return _look_at_sum(data, at)
        if not 32 <= byte <= 126 or at > MOST_BODY:
            return at + 1, False
    return 0, False


def _look_at_sum(data: bytearray, star: int) -> tuple[int, bool]:
    """As `_look`, for a frame whose body ends before the '*' at index `star`."""
    for at in range(star + 1, min(len(data), star + 6)):
        byte = data[at]
        if byte == BEGIN:
            return at, False
        if at < star + 5:
            if byte not in HEX:
                return at + 1, False
        else:
            right = byte == END and int(data[star + 1 : at], 16) == crc16(data[1:star])
            return at + 1, right
    return 0, False
