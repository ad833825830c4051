"""`tsd-record`: recorder of all robots on a bus, and export of its recordings."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tsd_twin.bus import (
    DEFAULT_ENDPOINT,
    Bus,
    Config,
    client_config,
    clients_of,
)
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError, needs_extra

with program.requires("tsd-record", "record"):
    from tsd_twin.recording import (
        ALLOWED,
        EVERYTHING,
        Annotation,
        Catalogue,
        Recorder,
        RecordingFolder,
        add_mark,
        export,
    )
    from tsd_twin.recording.folder import default_folder
    from tsd_twin.recording.index import RecordingIndex
    from tsd_twin.recording.reader import FolderReader


GB = 1_000_000_000

START_TIMEOUT_S = 3.0
"""Timeout of a connection attempt."""

PARSER = program.parser(
    "tsd-record",
    "Record all messages of all robots on a bus as MCAP: streams, commands, requests, events.",
    [
        "tsd-record                                    the robots on this machine",
        "tsd-record --dir drives --keep-gb 20          into a folder of yours",
        "tsd-record --connect tcp/127.0.0.1:7448       a robot at another endpoint",
        "kill -USR1 PID                                begin a new file",
        "tsd-record list                               what is in the folder",
        'tsd-record mark FILE "it slipped"             a note on this moment, or --at 12.5',
        "tsd-record export FILE --out part.mcap --from 10 --to 70    one minute, without lease ids",
        "tsd-record export FILE --csv tables           each stream as a CSV file",
        "tsd-record export FILE --html drive.html --to 60    a page that plays in any browser",
    ],
)


def record(args: argparse.Namespace) -> None:
    """Record until a signal arrives."""
    stop = program.stop_event(args)
    folder = RecordingFolder(args.dir, round(args.keep_gb * GB))
    for path in folder.complete_cut_files():
        print(f"completed {path}", flush=True)
    folder.remove_oldest()
    configs = sessions(args)
    try:
        recorder = Recorder(folder, notify=notify)
    except OSError as error:
        raise TwinError(f"{args.dir} cannot be written to: {error.strerror}") from error
    signal.signal(signal.SIGUSR1, lambda _number, _frame: recorder.new_file())
    keys = ALLOWED if args.zenoh_config else EVERYTHING
    taps = [Tap(recorder, config, keys, stop) for config in configs]
    program.say_ready(f"tsd-record into {recorder.file.path}")
    recorder.run(stop)
    for tap in taps:
        tap.close()
    for tap in taps:
        if tap.error is not None:
            raise tap.error


def sessions(args: argparse.Namespace) -> list[Config]:
    """Return a session configuration for each robot."""
    if args.zenoh_config:
        return clients_of(program.renewed_file(args.zenoh_config), START_TIMEOUT_S)
    return clients_of(client_config(args.connect or [DEFAULT_ENDPOINT]), START_TIMEOUT_S)


class Tap:
    """Session with a robot, opened once the robot is available."""

    def __init__(
        self, recorder: Recorder, config: Config, keys: Sequence[str], stop: threading.Event
    ) -> None:
        self._recorder, self._config, self._keys, self._stop = recorder, config, keys, stop
        self._bus: Bus | None = None
        self.error: TwinError | None = None
        """Reason why the session cannot be opened; `stop` is then set."""
        self._thread = threading.Thread(target=self._open)
        self._thread.start()

    def _open(self) -> None:
        try:
            self._bus = Bus.when_reachable(self._config, self._stop)
            if self._bus is not None:
                self._recorder.listen(self._bus, self._keys)
        except TwinError as error:
            self.error = error
            self._stop.set()

    def close(self) -> None:
        """Close the session, after waiting for an attempt to open it."""
        self._thread.join()
        if self._bus is not None:
            self._bus.close()


def notify(text: str) -> None:
    """Print a notice."""
    print(f"{datetime.now(UTC):%H:%M:%SZ} {text}", file=sys.stderr, flush=True)


def export_file(args: argparse.Namespace) -> None:
    """Export parts of a recording."""
    if not (args.out or args.csv or args.html or args.picture):
        raise TwinError(
            "export: --out FILE.mcap, --csv FOLDER, --html FILE or --picture FILE is needed"
        )
    part = export.RecordingSlice(Path(args.file), args.start_s, args.end_s, args.robot)
    if args.out:
        print(export.to_mcap(part, Path(args.out)))
    if args.csv:
        for line in export.to_csv(part, Path(args.csv)):
            print(line)
    if args.html or args.picture:
        # The scene takes a second to import: recording does without it.
        with needs_extra("A page or picture", "dashboard"):
            from tsd_twin.dashboard import html_export

        if args.html:
            print(html_export.to_html(part, Path(args.html)))
        if args.picture:
            print(html_export.to_picture(part, Path(args.picture)))


def list_recordings(args: argparse.Namespace) -> None:
    """Print start, duration, robots and marks of all recordings in the folder, latest last."""
    if not args.dir.is_dir():
        raise TwinError(f"{args.dir} is no folder")
    catalogue = Catalogue(args.dir, FolderReader())
    for path, each in reversed(catalogue.recordings().items()):
        start = datetime.fromtimestamp(1e-9 * each.start_ns, UTC)
        marks = f", {each.marks} mark{'s' * (each.marks > 1)}" if each.marks else ""
        state = "" if each.is_whole else ", without an index yet"
        title = f" '{each.title}'" if each.title else ""
        print(
            f"{start:%Y-%m-%d %H:%M:%SZ} {each.duration_s:8.1f} s {each.size / 1e6:7.1f} MB "
            f"{path.name}{title}: {', '.join(each.robots) or 'no robot'}{marks}{state}"
        )
    catalogue.close()


def mark(args: argparse.Namespace) -> None:
    """Attach a note to a time of a recording."""
    index = RecordingIndex(Path(args.file))
    duration_s = 1e-9 * (index.end_ns - index.start_ns)
    index.close()
    at_s = duration_s if args.at_s is None else args.at_s
    if at_s > duration_s:
        raise TwinError(f"--at {at_s:g} is no part of {duration_s:.1f} s")
    add_mark(index.path, Annotation(index.start_ns + round(at_s * 1e9), args.note))


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    program.add_recordings_flags(PARSER, "--dir")
    PARSER.set_defaults(body=record, dir=default_folder())
    commands = PARSER.add_subparsers(metavar="export | list | mark")
    about = "write a part of a recording as MCAP, CSV, a page, or a moving picture"
    _add_export_flags(commands.add_parser("export", help=about, **_EXPORT))
    about = "list the recordings in the folder: start, duration, robots, marks"
    parser = commands.add_parser("list", help=about, description=f"{about.capitalize()}.")
    parser.set_defaults(body=list_recordings)
    about = "attach a note to a time of a recording"
    parser = commands.add_parser("mark", help=about, description=f"{about.capitalize()}.")
    parser.add_argument("file", metavar="FILE", help="a recording")
    text = (
        "time, in seconds since its start; default: its end, which is now in one that is "
        "being written"
    )
    flags.add(parser, "--at", text, flags.number(0.0), metavar="S", dest="at_s")
    parser.add_argument("note", metavar="NOTE", help="text of at most 200 characters")
    parser.set_defaults(body=mark)
    program.run(PARSER, lambda args: args.body(args))


_EXPORT: dict[str, Any] = {
    "description": "Write a part of a recording as MCAP without lease ids, as CSV, as one HTML "
    "page that plays in any browser, or as a moving picture.",
    **program.with_examples(
        [
            "tsd-record export FILE --out part.mcap --from 10 --to 70",
            "tsd-record export FILE --csv tables --robot tsd",
            "tsd-record export FILE --html drive.html --from 10 --to 70",
            "tsd-record export FILE --picture drive.webp --from 10 --to 16",
        ]
    ),
}


def _add_export_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a recording")
    text = "start, in seconds; default: the start"
    flags.add(parser, "--from", text, flags.number(0.0), 0.0, "S", dest="start_s")
    text = "end, in seconds; default: the end"
    flags.add(parser, "--to", text, flags.POSITIVE, metavar="S", dest="end_s")
    parser.add_argument("--robot", metavar="ID", help="one robot; default: all")
    parser.add_argument("--out", metavar="FILE", help="MCAP file to write")
    parser.add_argument("--csv", metavar="FOLDER", help="folder for CSV files, one for a stream")
    parser.add_argument("--html", metavar="FILE", help="HTML page to write")
    text = "moving picture to write, .webp or .gif; needs Chromium and Playwright"
    parser.add_argument("--picture", metavar="FILE", help=text)
    parser.set_defaults(body=export_file)


if __name__ == "__main__":
    main()
