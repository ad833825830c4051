"""Mutation run of the firmware: changes its safety-relevant files by operators, one place at a
time, and runs the rules against each, on this machine. `make mutants` runs it.

A mutant that compiles to the same code as the firmware, or as another mutant, is left out. The
rest has to break a rule, or to be listed in `firmware/equivalent_mutants.txt` with the reason why
no rule can see it.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from firmware.simulator.board import BUILD, FIRMWARE, build_native
from tests.firmware import test_driving, test_line
from tests.support.firmware_host import Bench
from tests.support.firmware_rules import LAWS, Law

FILES = ("safety.c", "receiver.c", "servos.c", "manual.c", "table.c", "watchdog.c", "host_line.c")
LISTED = FIRMWARE / "equivalent_mutants.txt"
_NATIVE = BUILD / "native"
_CPU_S, _WALL_S = 7, 100.0
"""A mutant that takes longer hangs."""
_CFLAGS = ("-std=gnu11", "-O1", "-fPIC", "-w", f"-I{FIRMWARE}")
_SETTINGS = ("-DF_CPU=16000000UL", "-DHOST_BAUD=1000000UL", "-DSERVO_BAUD=1000000UL")

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
_CONDITION = re.compile(r"\b(?:if|while) \((?P<it>.*)\)(?: \{| \w.*;)$")
_STATEMENT = re.compile(r"^\s*(?:[\w.\->\[\]()*& ,+]+(?:=|\+\+|\().*;)$")
_SKIPPED = re.compile(r"^\s*(?:#|//|_Static_assert|typedef|static const|extern|case |default:)")


@dataclass(frozen=True)
class Mutant:
    """One changed place of one file."""

    file: str
    line: int
    before: str
    after: str

    @property
    def name(self) -> str:
        """Identity that outlives changes elsewhere in the file."""
        return f"{self.file}: {self.before.strip()} => {self.after.strip()}"


def mutants_of(file: str) -> Iterator[Mutant]:
    """All mutants of one file."""
    for number, full in enumerate((FIRMWARE / file).read_text(encoding="utf-8").splitlines()):
        line = full.partition("//")[0].rstrip()
        if not line or _SKIPPED.match(line):
            continue
        for after in dict.fromkeys(_changes(line)):
            if after != line:
                yield Mutant(file, number, line, after)


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
    if _STATEMENT.match(line) and "return" not in line and not _CONDITION.search(line):
        yield ";"
    if condition and line.endswith(";"):
        yield ";"


def _all_heard(bench: Bench) -> None:
    test_driving.test_servos_of_either_protocol_are_found_told_and_read((1, 2, 1, 2, 2, 1), bench)


def _waits(bench: Bench) -> None:
    test_driving.test_servos_that_answer_soon_are_heard_and_leave_time(100, 2, bench)


TESTS: dict[str, Law] = {
    **LAWS,
    **{
        test.__name__: test
        for test in (
            _all_heard,
            _waits,
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
        )
    },
}


def _broken_by(library: Path, tests: dict[str, Law]) -> str:
    """Name of the first rule that does not hold."""
    for name, test in tests.items():
        bench = Bench(library)
        try:
            test(bench)
            bench.finish()
        except Exception:  # Whatever it is: it does not hold.
            return name
        finally:
            bench.close()
    return ""


def _in_child(call: Callable[[], str]) -> str:
    """What `call` returns, in a process of its own; "crash" when that dies or takes too long."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S))
        os.close(reading)
        os.write(writing, call().encode() or b"-")
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        ready, _, _ = select.select([pipe], [], [], _WALL_S)
        said = pipe.read().decode() if ready else ""
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return said.removeprefix("-") if said else "crash"


def _compile(source: Path, output: Path) -> bool:
    run = ["gcc", *_SETTINGS, *_CFLAGS, "-c", "-o", str(output), str(source)]
    return subprocess.run(run, capture_output=True, check=False).returncode == 0


def _run(*words: str) -> None:
    subprocess.run(words, check=True)


def _link(folder: Path, file: str) -> Path:
    """Link the object in `folder` with all others, as the Makefile does."""
    others = [
        path for path in _NATIVE.glob("*.o") if path.stem not in {"firmware", Path(file).stem}
    ]
    whole, library = folder / "firmware.o", folder / "libfirmware.so"
    objects = [str(folder / "mutant.o"), *map(str, others)]
    _run("ld", "-r", "-o", str(whole), *objects)
    sections = ["--set-section-flags", ".bss=alloc,load,contents,data"]
    renamed = [".bss=firmware_bss", ".data=firmware_data"]
    rename = [word for name in renamed for word in ("--rename-section", name)]
    _run("objcopy", *sections, *rename, str(whole))
    board = str(_NATIVE / "hal/board.o")
    _run("gcc", "-shared", "-o", str(library), board, str(whole), "-lm")
    return library


def _object(mutant: Mutant, folder: Path) -> str:
    """Compile it; return the sum of its code, or "" when it does not compile."""
    lines = (FIRMWARE / mutant.file).read_text(encoding="utf-8").splitlines()
    lines[mutant.line] = mutant.after
    source = folder / mutant.file
    source.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if not _compile(source, folder / "mutant.o"):
        return ""
    return hashlib.sha256((folder / "mutant.o").read_bytes()).hexdigest()


_broke: Counter[str] = Counter()
"""How often each rule was broken: the likely ones come first."""


def try_mutant(mutant: Mutant) -> tuple[str, str]:
    """Return the sum of its code and the rule that it breaks, "" for none."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        digest = _object(mutant, folder)
        if not digest or digest == _original(mutant.file):
            return digest, "same" if digest else "does not compile"
        library = _link(folder, mutant.file)
        tests = {name: TESTS[name] for name in sorted(TESTS, key=lambda name: -_broke[name])}
        broken = _in_child(lambda: _broken_by(library, tests))
        _broke[broken] += 1
        return digest, broken


_originals: dict[str, str] = {}


def _original(file: str) -> str:
    if file not in _originals:
        with tempfile.TemporaryDirectory() as name:
            shutil.copy(FIRMWARE / file, name)
            _compile(Path(name) / file, Path(name) / "mutant.o")
            _originals[file] = hashlib.sha256((Path(name) / "mutant.o").read_bytes()).hexdigest()
    return _originals[file]


def _listed() -> dict[str, str]:
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", default=FILES)
    files = parser.parse_args().files
    build_native()
    broken = _broken_by(BUILD / "native/libfirmware.so", TESTS)
    if broken:
        _say(f"the firmware itself breaks {broken}")
        return 1
    listed, unknown, met = _listed(), 0, set[str]()
    for file in files:
        counts = {"broken": 0, "same code": 0, "equivalent": 0, "survived": 0}
        seen: set[str] = set()
        mutants = list(mutants_of(file))
        with ProcessPoolExecutor(max_workers=os.cpu_count()) as pool:
            results = pool.map(try_mutant, mutants)
            for mutant, (digest, broken) in zip(mutants, results, strict=True):
                if not digest:
                    continue
                if broken == "same" or digest in seen:
                    counts["same code"] += 1
                elif broken:
                    counts["broken"] += 1
                elif mutant.name in listed:
                    counts["equivalent"] += 1
                    met.add(mutant.name)
                else:
                    counts["survived"] += 1
                    _say(mutant.name)
                seen.add(digest)
        _say(", ".join([file, *(f"{what} {count}" for what, count in counts.items())]))
        unknown += counts["survived"]
    gone = [name for name in listed if name.split(":")[0] in files and name not in met]
    for name in gone:
        _say(f"listed, but broken by a rule or not there any more: {name}")
    return 1 if unknown or gone else 0


if __name__ == "__main__":
    sys.exit(main())
