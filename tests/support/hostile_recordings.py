"""Recordings that no recorder writes: decompression bombs, and random damage by seed."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import zstandard
from mcap.opcode import Opcode

from tests.support.recorded_drives import START_NS
from tsd_twin.recording.records import MAGIC

_HEADER = struct.Struct("<BQ")
_BLOCK = 16 << 20
_MESSAGE_HEAD = 22
_EDGES = (0, 1, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
_JSON = (
    b"[" * 50_000,
    b'{"a":' * 50_000,
    b'{"mode":"ready","hardware":' + b'{"a":' * 4000,
    b'"\xff\xfe"',
    b"1" * 5000,
    b'{"alive": 1e999}',
    b'{"robot": "' + b"[" * 10_000 + b'"}',
    b"NaN",
    b"",
    b"\x00" * 100_000,
)


def record(kind: int, body: bytes) -> bytes:
    """Return a record."""
    return _HEADER.pack(kind, len(body)) + body


def records(data: bytes) -> list[tuple[int, bytes]]:
    """Return kind and content of each record."""
    at, found = 0, list[tuple[int, bytes]]()
    while at < len(data):
        kind, length = _HEADER.unpack_from(data, at)
        at += _HEADER.size + length
        found.append((kind, data[at - length : at]))
    return found


def text(value: str) -> bytes:
    """Return a text after its length."""
    return struct.pack("<I", len(value.encode())) + value.encode()


@dataclass(frozen=True)
class Chunk:
    """Compressed chunk."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    packed: bytes
    channels: tuple[int, ...]

    @classmethod
    def of(cls, content: bytes, like: Chunk) -> Chunk:
        """Return a chunk with other content, and matching sizes and checksum."""
        packed = zstandard.compress(content)
        return replace(like, size=len(content), crc=zlib.crc32(content), packed=packed)

    def content(self) -> bytes:
        """Decompress the content."""
        return zstandard.decompress(self.packed)  # The frame contains the size.

    def body(self) -> bytes:
        """Return the record content."""
        head = struct.pack("<QQQI", self.start_ns, self.end_ns, self.size, self.crc)
        return head + text("zstd") + struct.pack("<Q", len(self.packed)) + self.packed


@dataclass(frozen=True)
class Parts:
    """Records of a recording, from which others are made."""

    definitions: tuple[bytes, ...]
    """Schemas and channels."""
    chunks: tuple[Chunk, ...]

    @classmethod
    def read(cls, path: Path) -> Parts:
        """Parse a whole file."""
        every = records(path.read_bytes()[len(MAGIC) : -len(MAGIC)])
        end = next(i for i, (kind, _) in enumerate(every) if kind == Opcode.DATA_END)
        known = (Opcode.SCHEMA, Opcode.CHANNEL)
        definitions = tuple(record(*each) for each in every[end:] if each[0] in known)
        chunks: list[Chunk] = []
        for kind, body in every[:end]:
            if kind == Opcode.CHUNK:
                head = struct.unpack_from("<QQQI", body)
                chunks.append(Chunk(*head, body[28 + 8 + 8 :], ()))
            elif kind == Opcode.MESSAGE_INDEX:
                channels = (*chunks[-1].channels, *struct.unpack_from("<H", body))
                chunks[-1] = replace(chunks[-1], channels=channels)
        return cls(definitions, tuple(chunks))

    def write(self, path: Path, *, repeats: int = 1, is_whole: bool = True) -> Path:
        """Write a file whose index lists each chunk `repeats` times."""
        data = bytearray(MAGIC + record(Opcode.HEADER, text("ros2") + text("hostile")))
        index = bytearray()
        for chunk in self.chunks:
            body = chunk.body()
            times = struct.pack("<QQ", chunk.start_ns, chunk.end_ns)
            place = struct.pack("<QQ", len(data), _HEADER.size + len(body))
            offsets = b"".join(struct.pack("<HQ", number, 0) for number in chunk.channels)
            sizes = (
                struct.pack("<QI", 0, 4)
                + b"zstd"
                + struct.pack("<QQ", len(chunk.packed), chunk.size)
            )
            entry = times + place + struct.pack("<I", len(offsets)) + offsets + sizes
            index += record(Opcode.CHUNK_INDEX, entry) * repeats
            data += record(Opcode.CHUNK, body)
            for number in chunk.channels:
                data += record(Opcode.MESSAGE_INDEX, struct.pack("<HI", number, 0))
        if is_whole:
            data += record(Opcode.DATA_END, bytes(4))
            summary = len(data)
            start_ns = min(chunk.start_ns for chunk in self.chunks)
            end_ns = max(chunk.end_ns for chunk in self.chunks)
            counts = (len(self.chunks), 0, 0, 0, 0, len(self.chunks), start_ns, end_ns, 0)
            data += b"".join(self.definitions)
            data += record(Opcode.STATISTICS, struct.pack("<QHIIIIQQI", *counts)) + index
            data += record(Opcode.FOOTER, struct.pack("<QQI", summary, 0, 0)) + MAGIC
        path.write_bytes(data)
        return path

    def with_bomb(self, size: int) -> Parts:
        """Return a copy with a chunk of a given size, mostly one message of zeros."""
        last = self.chunks[-1]
        head = _HEADER.pack(Opcode.MESSAGE, size - _HEADER.size)
        head += struct.pack("<HIQQ", last.channels[0], 1, last.end_ns, last.end_ns)
        packer = zstandard.ZstdCompressor().compressobj(size=size)
        packed = bytearray(packer.compress(head))
        left = size - len(head)
        while left:
            packed += packer.compress(bytes(min(left, _BLOCK)))
            left -= min(left, _BLOCK)
        packed += packer.flush()
        bomb = Chunk(last.start_ns, last.end_ns, size, 0, bytes(packed), last.channels)
        return replace(self, chunks=(*self.chunks[:-1], bomb, last))


def bombs(honest: Path, folder: Path) -> dict[str, Path]:
    """Write one hostile recording of each kind, based on a valid one."""
    parts = Parts.read(honest)
    first = parts.chunks[0]
    nested = _with_payloads(first, lambda _: b"[" * 400_000)
    overflow = first.content() + _HEADER.pack(Opcode.MESSAGE, (1 << 64) - 1)
    many = replace(parts, chunks=(*parts.chunks, *[_tiny(first)] * 5000))
    made = {
        "bomb of 0.5 GiB": parts.with_bomb(1 << 29).write(folder / "half.mcap"),
        "bomb of 2 GiB": parts.with_bomb(1 << 31).write(folder / "bomb.mcap"),
        "bomb of 2 GiB, cut": parts.with_bomb(1 << 31).write(
            folder / "tsd-cut.mcap", is_whole=False
        ),
        "one chunk, 200,000 times": replace(parts, chunks=parts.chunks[:1]).write(
            folder / "many_index.mcap", repeats=200_000
        ),
        "5000 chunks at one time": many.write(folder / "overlap.mcap"),
        "a length beyond the end": replace(
            parts, chunks=(Chunk.of(overflow, first), *parts.chunks[1:])
        ).write(folder / "len_overflow.mcap"),
        "nested JSON": replace(parts, chunks=(*parts.chunks[:-1], nested, parts.chunks[-1])).write(
            folder / "nested.mcap"
        ),
    }
    largest = 6 << 20  # Maximum size of a message.
    zeros = tuple(replace(parts, chunks=parts.chunks[-1:]).with_bomb(largest).chunks[:1]) * 200
    made["200 chunks of 6 MiB"] = replace(parts, chunks=(*parts.chunks, *zeros)).write(
        folder / "planted.mcap"
    )
    return made


def _tiny(like: Chunk) -> Chunk:
    message = struct.pack("<HIQQ", like.channels[0], 1, START_NS, START_NS) + b"{}"
    tiny = Chunk.of(record(Opcode.MESSAGE, message), like)
    return replace(tiny, start_ns=0, end_ns=like.end_ns)


def _with_payloads(chunk: Chunk, change: Callable[[bytes], bytes]) -> Chunk:
    content = b"".join(
        record(
            kind,
            body[:_MESSAGE_HEAD] + change(body[_MESSAGE_HEAD:])
            if kind == Opcode.MESSAGE and i % 20 == 0
            else body,
        )
        for i, (kind, body) in enumerate(records(chunk.content()))
    )
    return Chunk.of(content, chunk)


def damaged(honest: Path, path: Path, seed: int) -> Path:
    """Write a copy of a valid recording with one of several kinds of damage."""
    dice = random.Random(seed)  # noqa: S311  The same file for the same seed.
    if seed % 2:
        path.write_bytes(_bytes_changed(bytearray(honest.read_bytes()), dice))
        return path
    parts = Parts.read(honest)
    chunks = list(parts.chunks)
    for _ in range(dice.choice((1, 1, 3, 20))):
        i = dice.randrange(len(chunks))
        chunks[i] = dice.choice(_CHANGES)(chunks[i], dice)
    if dice.random() < 0.2:
        dice.shuffle(chunks)
    made = replace(parts, chunks=tuple(chunks))
    if dice.random() < 0.2:
        made = made.with_bomb(dice.choice((1 << 20, 7 << 20, 9 << 20, 64 << 20)))
    made.write(path, repeats=dice.choice((1, 1, 1, 2, 1000)), is_whole=dice.random() < 0.7)
    return path


def _bytes_changed(data: bytearray, dice: random.Random) -> bytes:
    """Change bytes anywhere, mostly in the summary."""
    for _ in range(dice.choice((1, 2, 8, 40))):
        at = dice.randrange(len(data))
        if dice.random() < 0.6:
            at = len(data) - 1 - dice.randrange(min(len(data), 8000))
        match dice.randrange(5):
            case 0 | 1:
                data[at] ^= 1 << dice.randrange(8)
            case 2:
                data[at : at + 8] = struct.pack("<Q", dice.choice(_EDGES))
            case 3:
                data[at : at + 4] = struct.pack("<I", dice.choice(_EDGES) & 0xFFFFFFFF)
            case _:
                del data[at : at + dice.choice((1, 8, 100))]
        if len(data) < 64:
            break
    if dice.random() < 0.3:
        del data[-dice.randrange(1, len(data)) :]
    return bytes(data)


def _times(chunk: Chunk, dice: random.Random) -> Chunk:
    edges = (*_EDGES, chunk.start_ns, chunk.end_ns, START_NS + 10**12)
    return replace(chunk, start_ns=dice.choice(edges), end_ns=dice.choice(edges))


def _size(chunk: Chunk, dice: random.Random) -> Chunk:
    return replace(
        chunk, size=dice.choice((*_EDGES, max(chunk.size - 1, 0), chunk.size // 2)), crc=0
    )


def _content(chunk: Chunk, dice: random.Random) -> Chunk:
    content = bytearray(chunk.content())
    for _ in range(dice.choice((1, 5, 50))):
        at = dice.randrange(len(content) + 1)
        edge = struct.pack("<Q", dice.choice(_EDGES))
        content[at : at + 8] = edge[: dice.choice((1, 2, 4, 8))]
    return Chunk.of(bytes(content), chunk)


def _payloads(chunk: Chunk, dice: random.Random) -> Chunk:
    try:
        return _with_payloads(chunk, lambda _: dice.choice(_JSON))
    except struct.error:  # It was already changed.
        return chunk


def _channels(chunk: Chunk, dice: random.Random) -> Chunk:
    return replace(
        chunk, channels=tuple(dice.randrange(1 << 16) for _ in range(dice.randrange(500)))
    )


def _many(chunk: Chunk, dice: random.Random) -> Chunk:
    message = struct.pack(
        "<HIQQ", dice.choice(chunk.channels or (1,)), 1, chunk.start_ns, chunk.end_ns
    )
    return Chunk.of(record(Opcode.MESSAGE, message) * dice.choice((60_000, 70_000)), chunk)


_CHANGES = (_times, _size, _content, _content, _payloads, _payloads, _channels, _many)
