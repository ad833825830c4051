"""Mutation run of the firmware: changes its safety-relevant files by operators, one place at a
time, and runs the rules against each, on this machine. `make mutants` runs it.

Mutants are skipped if they compile to the same code as the firmware or another mutant, for this
machine or for the chip. The others must break a rule, or be listed in
`firmware/equivalent_mutants.txt` with the reason why no rule can detect them. An interrupted run
resumes if the sources have not changed.
"""

from __future__ import annotations

import argparse
import faulthandler
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

from firmware.simulator.board import BUILD, FIRMWARE, build_native
from tests.firmware import (
    test_driving,
    test_edges,
    test_eeprom,
    test_line,
    test_power,
    test_receiver_lines,
    test_servo_cycle,
    test_trips,
)
from tests.firmware.rules import ALL_LAWS, Law
from tests.support.firmware_host import Bench

FILES = (
    "watchdog.c", "table.c", "manual.c", "host_line.c", "receiver.c", "pulses.c", "sbus.c",
    "servos.c", "safety.c", "power.c", "packet.c", "nonce.c", "esc.c", "setup.c", "protocol1.c",
    "protocol2.c", "gimbals.c", "wheel_speed.c", "wheel_following.c", "wheel_telemetry.c",
    "esc_telemetry.c", "trip_history.c", "light.c",
)  # fmt: skip
LISTED = FIRMWARE / "equivalent_mutants.txt"
_JUDGED = BUILD / "mutants.jsonl"
"""Verdicts by mutant, after a line with the hash of the sources and the rules broken earlier."""
_SOURCES = ("firmware/**/*.[ch]", "firmware/**/*.py", "src/**/*.py", "src/**/*.toml",
            "tests/firmware/*.py", "tests/support/*.py")  # fmt: skip
_NATIVE = BUILD / "native"
_PATIENCE = 10.0
"""A rule that takes so many times longer than without the change hangs."""
_CPPFLAGS = (
    "-DF_CPU=16000000UL", "-DHOST_BAUD=1000000UL", "-DSERVO_BAUD=1000000UL", "-DBUILD_HASH=0UL",
    f"-I{FIRMWARE}",
)  # fmt: skip
_CFLAGS = ("-std=gnu11", "-w")
_CHECKED = (
    "gcc", "-O1", "-fPIC", "-fsanitize=bounds,object-size",
    "-fsanitize-undefined-trap-on-error",
    "-U_FORTIFY_SOURCE", "-D_FORTIFY_SOURCE=3",
)  # fmt: skip
"""An index beyond its array ends the program."""
_PLAIN = ("gcc", "-O2", "-fPIC")
_CHIP = (
    "avr-gcc",
    "-mmcu=atmega2560",
    "-Os",
    "-ffunction-sections",
    "-fdata-sections",
    "-fno-common",
)

_KINDS = ("mutants", "do not compile", "same code", "broken", "equivalent", "survived")

_SWAPS = {
    "<=": ("<", ">"), ">=": (">", "<"), "==": ("!=",), "!=": ("==",), "<": ("<=", ">="),
    ">": (">=", "<="), "&&": ("||",), "||": ("&&",), "++": ("--",), "--": ("++",),
    "+=": ("-=",), "-=": ("+=",), "|=": ("&=", "="), "&=": ("|=",), "+": ("-",), "-": ("+",),
    "*": ("/",), "/": ("*",), "%": ("/",), "&": ("|",), "|": ("&",), "^": ("|",), "<<": (">>",),
    "!": ("",), "~": ("",), "?": ("|| 1 ?", "&& 0 ?"), "true": ("false",), "false": ("true",),
}  # fmt: skip
_TOKEN = re.compile(
    r"<<|<=|>=|==|!=|&&|\|\||\+\+|--|\+=|-=|\|=|&=|->|[<>+\-*/%&|^!~?]|\b(?:true|false)\b"
    r"|\b\d+(?:\.\d+f)?\b"
)
_FUNCTION = re.compile(r"^(?:\w[^;=(]*\W)?(?P<name>\w+)\((?P<inside>\w+)?.*\{")
_BODY = re.compile(r"^(?P<head>\w.*\{) (?!return).*; \}$")
_CONDITION = re.compile(r"\b(?:if|while) \((?P<it>.*)\)(?: \{| \w.*;)$")
_STATEMENT = re.compile(r"^\s*(?:[\w.\->\[\]()*& ,+]+(?:=|\+\+|\().*;)$")
_SKIPPED = re.compile(r"^\s*(?:#|//|_Static_assert|typedef|static const|extern|case |default:)")


@dataclass(frozen=True)
class Mutant:
    """Change at one place of a file."""

    file: str
    line: int
    """From 1."""
    function: str
    """Where it is, and which of those that look alike there."""
    before: str
    after: str

    @property
    def name(self) -> str:
        """Identity that outlives changes elsewhere in the file."""
        return f"{self.file} {self.function}: {self.before.strip()} => {self.after.strip()}"

    def source(self) -> str:
        """Text of the file with the change."""
        lines = _lines(self.file)
        return "\n".join([*lines[: self.line - 1], self.after, *lines[self.line :]]) + "\n"


@cache
def _lines(file: str) -> list[str]:
    return (FIRMWARE / file).read_text(encoding="utf-8").splitlines()


class Verdict(NamedTuple):
    """Verdict on a mutant."""

    code: str
    """Sum of its code; "" when it does not compile."""
    broken: str
    """Rule that it breaks; "" for none, "same" for the code of the firmware."""
    took_s: float
    """Time of a processor."""


def mutants_of(file: str) -> list[Mutant]:
    """Return all mutants of a file."""
    found: list[Mutant] = []
    function = "file"
    seen: Counter[tuple[str, str]] = Counter()
    for number, full in enumerate(_lines(file), start=1):
        line = full.partition("//")[0].rstrip()
        begins = _FUNCTION.match(line)
        if begins:
            function = begins["inside" if begins["name"] == "HAL_INTERRUPT" else "name"]
        if line and not _SKIPPED.match(line):
            seen[function, line.strip()] += 1
            count = seen[function, line.strip()]
            where = function if count == 1 else f"{function} #{count}"
            changed = (after for after in dict.fromkeys(_changes(line)) if after != line)
            found.extend(Mutant(file, number, where, line, after) for after in changed)
        if full.startswith("}") or (begins and line.endswith("}")):
            function = "file"
    return found


def _changes(line: str) -> Iterator[str]:
    for match in _TOKEN.finditer(line):
        token = match.group()
        head, tail = line[: match.start()], line[match.end() :]
        new = _SWAPS.get(token, ())
        if token[0].isdigit():
            new = (f"({token} + 1)", f"({token} - 1)")
        for other in new:
            yield head + other + tail
    condition = _CONDITION.search(line)
    if condition:
        for value in ("true", "false"):
            yield line[: condition.start("it")] + value + line[condition.end("it") :]
    if _STATEMENT.match(line) and "return" not in line and not condition:
        yield ";"
    if condition and line.endswith(";"):
        yield ";"
    body = _BODY.match(line)
    if body:
        yield body["head"] + "}"


def _all_heard(bench: Bench) -> None:
    test_driving.test_servos_of_either_protocol_are_found_told_and_read((1, 2, 1, 2, 2, 1), bench)


_TESTS: tuple[Law, ...] = (
    _all_heard,
    test_driving.test_throttles_are_put_out_to_half_a_microsecond,
    test_driving.test_a_board_that_gets_power_says_who_it_is,
    test_driving.test_battery_and_receiver_are_measured,
    test_driving.test_the_radio_control_drives_by_the_kinematics_of_the_drive,
    test_driving.test_sticks_that_jump_are_approached_within_the_acceleration,
    test_line.test_lost_bytes_are_counted,
    test_line.test_answers_without_room_are_left_out_as_a_whole,
    test_line.test_an_armed_board_drives_on_among_garbage,
    test_line.test_every_length_of_read_is_answered_with_what_stands_there,
    test_line.test_what_looks_like_a_header_inside_a_packet_is_stuffed_both_ways,
    test_trips.test_the_ring_keeps_the_last_eight_over_many_turns_and_wears_all_cells_alike,
    test_trips.test_any_cut_of_a_write_leaves_the_other_trips,
    test_trips.test_memory_that_never_held_trips_holds_none,
    *(
        test
        for module in (test_edges, test_eeprom, test_power, test_receiver_lines, test_servo_cycle)
        for name, test in vars(module).items()
        if name.startswith("test_")
    ),
)
TESTS: dict[str, Law] = {**ALL_LAWS, **{test.__name__: test for test in _TESTS}}


def _holds(library: Path, test: Law) -> bool:
    bench = Bench(library)
    try:
        test(bench)
        bench.finish()
    except Exception:  # Any error means that the rule is broken.
        return False
    finally:
        bench.close()
    return True


def _broken(library: Path, names: Iterable[str], limits_s: Mapping[str, float]) -> str:
    """Name of the first rule that does not hold, or in which the program crashes or hangs."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        faulthandler.disable()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # The C library says why it ends a program.
        signal.signal(signal.SIGPROF, signal.SIG_DFL)  # It ends a loop in C, too.
        for name in names:
            os.write(writing, f"{name}\n".encode())
            signal.setitimer(signal.ITIMER_PROF, limits_s[name])
            if not _holds(library, TESTS[name]):
                os._exit(0)
        os.write(writing, b"\n")
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        begun = pipe.read().decode()
    os.waitpid(child, 0)
    return begun.split("\n")[-2]


def _compile(source: Path, output: Path, compiler: Iterable[str]) -> bool:
    run = [*compiler, *_CPPFLAGS, *_CFLAGS, "-c", "-o", str(output), str(source)]
    return subprocess.run(run, capture_output=True, check=False).returncode == 0


def _code(file: str, source: str, compiler: Iterable[str], folder: Path) -> str:
    """Compile it to `folder`; return the sum of its code, or "" when it does not compile."""
    path, output = folder / file, folder / "mutant.o"
    path.write_text(source, encoding="utf-8")
    if not _compile(path, output, compiler):
        return ""
    return hashlib.sha256(output.read_bytes()).hexdigest()


@cache
def _original(file: str, compiler: tuple[str, ...]) -> str:
    with tempfile.TemporaryDirectory() as name:
        return _code(file, "\n".join(_lines(file)) + "\n", compiler, Path(name))


def _is_same(mutant: Mutant, folder: Path) -> bool:
    """Whether a mutant has the code of the firmware, for this machine or for the chip."""
    return any(
        _code(mutant.file, mutant.source(), compiler, folder) == _original(mutant.file, compiler)
        for compiler in (_PLAIN, _CHIP)
    )


def _link(folder: Path, objects: Iterable[Path]) -> Path:
    """Link a library in `folder`, as the Makefile does."""
    whole, library = folder / "firmware.o", folder / "libfirmware.so"
    sections = ["--set-section-flags", ".bss=alloc,load,contents,data"]
    rename = ["--rename-section", ".bss=firmware_bss", "--rename-section", ".data=firmware_data"]
    for run in (
        ["ld", "-r", "-o", whole, *objects],
        ["objcopy", *sections, *rename, whole],
        ["gcc", "-shared", "-o", library, _NATIVE / "hal/board.o", whole, "-lm"],
    ):
        subprocess.run(list(map(str, run)), check=True)
    return library


def _others(checked: Path, file: str = "") -> list[Path]:
    """Objects of all files but `file`: those that are changed check their bounds, too."""
    names = [path.stem for path in FIRMWARE.glob("*.c") if path.name != file]
    return [(checked if f"{name}.c" in FILES else _NATIVE) / f"{name}.o" for name in names]


@dataclass
class Referee:
    """Judge of mutants: the rules, in the order in which they will probably notice."""

    checked: Path
    """Folder of the objects that check their bounds."""
    limits_s: dict[str, float] = field(default_factory=dict[str, float])
    names: list[str] = field(default_factory=list[str])

    def prepare(self, names: Iterable[str]) -> str:
        """Compile the firmware and time the rules; return the first that does not hold."""
        self.names = list(names)
        for file in FILES:
            _compile(FIRMWARE / file, self.checked / Path(file).with_suffix(".o"), _CHECKED)
        library = _link(self.checked, _others(self.checked))
        for name in self.names:
            start_s = time.process_time()
            if not _holds(library, TESTS[name]):
                return name
            self.limits_s[name] = max(1.0, _PATIENCE * (time.process_time() - start_s))
        self.names.sort(key=lambda name: self.limits_s[name])
        return ""

    def judge(self, mutant: Mutant, before: str | None) -> tuple[str, str]:
        """Return the sum of the mutant's code and the rule that it breaks, as `Verdict` has them.

        `before` is the rule that it broke in the last run.
        """
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            code = _code(mutant.file, mutant.source(), _CHECKED, folder)
            if not code:
                return "", ""
            if code == _original(mutant.file, _CHECKED):
                return code, "same"
            library = _link(folder, [folder / "mutant.o", *_others(self.checked, mutant.file)])
            if before in self.names:
                self._prefer(before)
            elif _is_same(mutant, folder):
                return code, "same"
            broken = _broken(library, self.names, self.limits_s)
            if broken:
                self._prefer(broken)
            elif _is_same(mutant, folder):
                return code, "same"
            return code, broken

    def _prefer(self, name: str) -> None:
        self.names.remove(name)
        self.names.insert(0, name)


_referees: list[Referee] = []
"""That of this process."""


def _judge(mutant: Mutant, before: str | None) -> Verdict:
    start_s = sum(os.times()[:4])
    code, broken = _referees[-1].judge(mutant, before)
    return Verdict(code, broken, round(sum(os.times()[:4]) - start_s, 2))


@dataclass
class Memory:
    """Verdicts of earlier runs, by the names of mutants."""

    broke: dict[str, str] = field(default_factory=dict[str, str])
    """Rule that it broke last, even if sources have changed; it is tried first."""
    judged: dict[str, Verdict] = field(default_factory=dict[str, Verdict])
    """Verdicts about these very sources."""
    file: Path | None = None

    def add(self, name: str, verdict: Verdict) -> None:
        """Remember a verdict."""
        self.judged[name] = verdict
        if self.file is not None:
            with self.file.open("a", encoding="utf-8") as out:
                out.write(json.dumps([name, *verdict]) + "\n")

    @staticmethod
    def read(file: Path, sources: str) -> Memory:
        """Read verdicts from a file; discard them if they belong to other sources."""
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else ['["", {}]']
        found = {name: Verdict(*rest) for name, *rest in map(json.loads, lines[1:])}
        of, broke = json.loads(lines[0])
        for name, verdict in found.items():
            broke.pop(name, None)
            if verdict.broken not in ("", "same"):
                broke[name] = verdict.broken
        if of != sources:
            found = {}
            file.write_text(json.dumps([sources, broke]) + "\n", encoding="utf-8")
        return Memory(broke, found, file)


def _sum_of_sources() -> str:
    root, found = FIRMWARE.parent, hashlib.sha256()
    for path in sorted(path for pattern in _SOURCES for path in root.glob(pattern)):
        found.update(path.read_bytes())
    return found.hexdigest()


def run(
    mutants: list[Mutant],
    referee: Referee,
    listed: Iterable[str],
    memory: Memory | None = None,
    *,
    jobs: int = 1,
) -> Iterator[tuple[Mutant, str, str]]:
    """Judge mutants of a file; yield each with its kind and the rule that it breaks."""
    memory, seen = memory or Memory(), set[str]()
    left = [mutant for mutant in mutants if mutant.name not in memory.judged]
    before = [memory.broke.get(mutant.name) for mutant in left]
    with ProcessPoolExecutor(jobs, initializer=_referees.append, initargs=(referee,)) as pool:
        verdicts = pool.map(_judge, left, before)
        for mutant in mutants:
            if mutant.name not in memory.judged:
                memory.add(mutant.name, next(verdicts))
            code, broken, _ = memory.judged[mutant.name]
            if not code:
                yield mutant, "do not compile", ""
            elif broken == "same" or code in seen:
                yield mutant, "same code", ""
            elif broken:
                yield mutant, "broken", broken
            else:
                yield mutant, "equivalent" if mutant.name in listed else "survived", ""
            seen.add(code)


def read_list() -> dict[str, str]:
    """Mutants that no rule can see, with the reason."""
    found: dict[str, str] = {}
    reason = ""
    for line in LISTED.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            reason = line[2:]
        elif line:
            found[line] = reason
    return found


def _say(words: str) -> None:
    sys.stdout.write(words + "\n")
    sys.stdout.flush()


def _run_file(file: str, referee: Referee, given: argparse.Namespace, memory: Memory) -> bool:
    """Judge the mutants of a file and print the verdicts; return whether all are as required."""
    listed = {it for it in read_list() if it.startswith(f"{file} ") and given.only in it}
    mutants = [it for it in mutants_of(file) if given.only in it.name]
    names = {it.name for it in mutants}
    if given.left:
        mutants = [it for it in mutants if it.name not in memory.broke]
    counts, met = Counter[str](), set[str]()
    for it, kind, rule in run(mutants, referee, listed, memory, jobs=given.jobs):
        counts.update(["mutants", kind])
        if kind == "survived" or given.all:
            _say(f"{file}:{it.line}: {kind}: {it.name}" + (f" [{rule}]" if rule else ""))
        if kind == "equivalent":
            met.add(it.name)
        if counts["mutants"] % 50 == 0:
            _say(f"{file}: {counts['mutants']} of {len(mutants)}")
    figures = ", ".join(f"{counts[kind]} {kind}" for kind in _KINDS)
    took_s = sum(memory.judged[it.name].took_s for it in mutants)
    _say(f"{file}: {figures}; {took_s:.0f} s of a processor")
    for name in sorted(listed - met):
        why = "breaks a rule, or is the same code" if name in names else "is not there"
        _say(f"listed, but it {why}: {name}")
    return not counts["survived"] and listed == met


def main() -> int:
    """Run it; return 0 when each mutant breaks a rule or is listed, and nothing else is listed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", default=FILES)
    parser.add_argument("--only", default="", help="mutants that have this in their name")
    parser.add_argument("--left", action="store_true", help="those that broke none last time")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--all", action="store_true", help="print all mutants, not the survivors")
    given = parser.parse_args()
    build_native()
    memory = Memory.read(_JUDGED, _sum_of_sources())
    with tempfile.TemporaryDirectory() as name:
        referee = Referee(Path(name))
        broken = referee.prepare(TESTS)
        if broken:
            _say(f"the firmware itself breaks {broken}")
            return 1
        right = [_run_file(file, referee, given, memory) for file in given.files]
    return 0 if all(right) else 1


if __name__ == "__main__":
    sys.exit(main())
