"""Complete the image of the RP2040's flash with the boot checksum, and write the file for USB.

python firmware/rp2040/image.py firmware.bin firmware.uf2
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

_STAGE = 252
_FLASH = 0x10000000
_PAGE = 256
_FAMILY = 0xE48BFF56


def checksum(data: bytes) -> int:
    """CRC-32 with the polynomial 0x04C11DB7, not reflected, as the boot ROM computes it."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


def image(linked: bytes) -> bytes:
    """Return the linked image with the checksum of its second stage, in whole pages."""
    stage = linked[:_STAGE]
    data = stage + struct.pack("<I", checksum(stage)) + linked[_STAGE + 4 :]
    return data + bytes(-len(data) % _PAGE)


def uf2(data: bytes) -> bytes:
    """Return an image as a file for the USB drive of the boot ROM."""
    count = len(data) // _PAGE
    blocks = [
        struct.pack(
            "<8I476sI",
            0x0A324655, 0x9E5D5157, 0x2000, _FLASH + i * _PAGE, _PAGE, i, count, _FAMILY,
            data[i * _PAGE : (i + 1) * _PAGE], 0x0AB16F30,
        )
        for i in range(count)
    ]  # fmt: skip
    return b"".join(blocks)


def main(binary: Path, drive_file: Path) -> None:
    """Complete an image in place, and write the file for USB."""
    data = image(binary.read_bytes())
    binary.write_bytes(data)
    drive_file.write_bytes(uf2(data))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
