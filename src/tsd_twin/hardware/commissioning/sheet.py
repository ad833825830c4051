"""Sheet of a commissioning: results that are saved after each step, and the page to sign."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from tsd_twin.hardware.commissioning.findings import Finding
from tsd_twin.hardware.serial_transport import HardwareError


class Result(msgspec.Struct, frozen=True):
    """Result of a step."""

    step: str
    at: str
    """Date and time, ISO 8601."""
    finding: Finding | None = None
    """Error found, or None if the step passed."""
    value: float | None = None
    """Value measured by a person."""


class Sheet(msgspec.Struct):
    """Results of all steps so far, for one machine."""

    robot: str
    kind: str
    results: list[Result] = []

    def passed(self) -> set[str]:
        """Return the names of the steps whose last result is a pass."""
        last = {result.step: result for result in self.results}
        return {name for name, result in last.items() if result.finding is None}

    def save(self, file: Path) -> None:
        """Write the sheet; a power cut leaves the old file or the new one.

        Raises:
            HardwareError: If the file cannot be written.
        """
        part = file.with_name(file.name + ".part")
        try:
            with part.open("wb") as out:
                out.write(msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n")
                out.flush()
                os.fsync(out.fileno())
            part.replace(file)
        except OSError as error:
            raise HardwareError(f"cannot write the sheet {file}: {error}") from error

    def page(self) -> str:
        """Return the page to sign: the last result of each step."""
        last = {result.step: result for result in self.results}
        rows = [
            f"{'ok  ' if it.finding is None else 'FAIL'} {it.at}  {it.step:<24}"
            + ("" if it.value is None else f" {it.value:g}")
            + ("" if it.finding is None else f" {it.finding.sentence()}")
            for it in last.values()
        ]
        title = f"Commissioning of {self.robot} ({self.kind})"
        names = "Name: ____________________  Date: ____________  Signature: ____________________"
        return "\n".join([title, "", *rows, "", names, ""])


def read_sheet(file: Path, robot: str, kind: str) -> Sheet:
    """Return the sheet in a file to continue it, or a new one.

    Raises:
        HardwareError: If the file is not a sheet, or is the sheet of another machine.
    """
    if not file.exists():
        return Sheet(robot, kind)
    try:
        sheet = msgspec.json.decode(file.read_bytes(), type=Sheet)
    except (OSError, msgspec.DecodeError) as error:
        raise HardwareError(f"{file} is not a commissioning sheet: {error}") from error
    if (sheet.robot, sheet.kind) != (robot, kind):
        raise HardwareError(
            f"{file} is the sheet of {sheet.robot} ({sheet.kind}), not of {robot} ({kind}): "
            "choose another file"
        )
    return sheet
