"""Recording readers yield the processor to their dashboard."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.programs import recording_readers
from tests.support.recorded_drives import recorded_circle
from tsd_twin.recording.reader_process import CPU_S, MEMORY_BYTES, NICE
from tsd_twin.recording.remote import ReaderProcesses, RemoteReader

pytestmark = pytest.mark.system


def test_a_reader_is_the_first_to_wait_and_the_first_to_end(tmp_path: Path) -> None:
    path = recorded_circle(tmp_path / "drive.mcap", 1)
    others = recording_readers()
    with closing(ReaderProcesses()) as processes, closing(RemoteReader(path, processes)) as reader:
        assert reader.contents().robots
        (child,) = recording_readers() - others
        assert int(Path(f"/proc/{child}/oom_score_adj").read_text()) == 1000
        assert os.getpriority(os.PRIO_PROCESS, child) == os.getpriority(os.PRIO_PROCESS, 0) + NICE
        limits = {
            line[:26].strip(): line[26:].split()[0]
            for line in Path(f"/proc/{child}/limits").read_text().splitlines()[1:]
        }
        assert 0 < int(limits["Max cpu time"]) <= CPU_S + 2
        assert MEMORY_BYTES < int(limits["Max address space"]) < 4 * MEMORY_BYTES
