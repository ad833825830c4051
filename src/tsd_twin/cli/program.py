"""Common parts of all programs: flags, signals, one-sentence errors."""

from __future__ import annotations

import argparse
import contextlib
import difflib
import gc
import logging
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path
from queue import SimpleQueue
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from tsd_twin import __version__
from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, Config, client_config, from_file, node_config
from tsd_twin.cli import flags
from tsd_twin.errors import MissingExtraError, TwinError, check_extra
from tsd_twin.messages import topics
from tsd_twin.security import BusIdentity, Role

if TYPE_CHECKING:
    from ssl import SSLContext  # Takes 4 MB, which a router need not spend.

_LOG = logging.getLogger(__name__)
_PATIENCE_S = 2.0
_LOG_BYTES, _LOG_PARTS = 1_000_000, 5


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports a mistake in one sentence, with exit code 2."""

    def error(self, message: str) -> NoReturn:
        """End the program with the message, and with the flag that was meant, if one is near."""
        unknown = _UNKNOWN.match(message)
        near = unknown and difflib.get_close_matches(unknown[1], self._option_string_actions, n=1)
        meant = f", did you mean {near[0]}?" if near else f"; see {self.prog} --help"
        self.exit(2, f"{self.prog}: {message.removeprefix('argument ')}{meant}\n")


_UNKNOWN = re.compile(r"unrecognized arguments: (--?[\w-]+)")


@contextlib.contextmanager
def requires(prog: str, extra: str) -> Generator[None]:
    """Import what a program needs of an extra inside this context.

    If a package of the extra is not installed, the program ends with a one-sentence message and
    exit code 2.
    """
    try:
        check_extra(prog, extra)
        yield
    except MissingExtraError as error:
        print(error, file=sys.stderr)  # noqa: T201  Message of the program to its user.
        sys.exit(2)


def parser(prog: str, purpose: str, examples: Sequence[str]) -> argparse.ArgumentParser:
    """Argument parser whose help ends with `examples`."""
    made = _Parser(prog=prog, description=purpose, **with_examples(examples))
    made.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    made.add_argument(
        "--until-eof", action="store_true", help="end when standard input ends, as a child does"
    )
    made.add_argument("-v", "--verbose", action="store_true", help="log in detail to stderr")
    text = f"also log in detail to FILE; older parts are FILE.1 to FILE.{_LOG_PARTS}, 1 MB each"
    made.add_argument("--log-file", type=Path, metavar="FILE", help=text)
    return made


def with_examples(examples: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a parser whose help ends with `examples`."""
    return {
        "epilog": "examples:\n" + "\n".join(f"  {example}" for example in examples),
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def add_viewport_flags(made: argparse.ArgumentParser) -> None:
    """Add the flags of the port that serves viser's page."""
    text = (
        "of the 3D view in the page; default: the port after that of the page, or any free "
        "one if that is in use or --port is 0. If browsers cannot reach it, the view comes from "
        "the port of the page, and a slow view then slows down the page"
    )
    flags.add(made, "--viewport-port", text, flags.PORT, metavar="PORT")
    text = (
        "at which browsers reach the port of the 3D view, if a proxy or tunnel changes it: "
        "the page's name with another port, as https://robot.example:8443"
    )
    flags.add(made, "--viewport-origin", text, flags.web_origin, metavar="URL")


def viewport_flags(args: argparse.Namespace) -> list[str]:
    """Return the given flags of `add_viewport_flags`, for another program."""
    given = {"--viewport-port": args.viewport_port, "--viewport-origin": args.viewport_origin}
    return [text for key, value in given.items() if value is not None for text in (key, str(value))]


def add_node_flags(made: argparse.ArgumentParser) -> None:
    """Add the bus flags of a robot node: `--listen`, `--connect`, `--zenoh-config`."""
    add_listen_flag(made)
    text = "a router to join as well"
    flags.add(made, "--connect", text, metavar="ENDPOINT", repeated=True)
    made.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, for TLS and access")
    add_signature_flags(made)


def add_signature_flags(made: argparse.ArgumentParser) -> None:
    """Add `--operators` and `--unsigned`."""
    text = "obey signed commands of this list only; default: the one beside --zenoh-config"
    flags.add(made, "--operators", text, Path, metavar="FILE")
    text = "obey commands without signature, also behind a router, which could then drive"
    made.add_argument("--unsigned", action="store_true", help=text)


def operators_file(args: argparse.Namespace) -> Path | None:
    """Return the list of operators whose signatures a robot requires, or None.

    Raises:
        TwinError: If flags conflict, or a robot behind a router has no list.
    """
    if args.unsigned:
        if args.operators is not None:
            raise TwinError("--operators and --unsigned exclude each other")
        return None
    if args.operators is not None or not args.zenoh_config:
        return args.operators
    file = Path(args.zenoh_config).with_name("operators.json")
    if file.exists():
        return file
    if from_file(args.zenoh_config).robot is not None:
        raise TwinError(
            f"{file} is missing: behind a router, a robot obeys signed commands only. Run "
            "tsd-certs with the folder of the router again and copy operators.json here, and "
            "its .sign files to the operators; or say --unsigned, and the router could drive"
        )
    return None


def add_listen_flag(made: argparse.ArgumentParser) -> None:
    """Add `--listen`, the endpoint of a bus."""
    text = f"where the bus listens; default {DEFAULT_ENDPOINT}, port 0 takes a free one"
    flags.add(made, "--listen", text, default=DEFAULT_ENDPOINT, metavar="ENDPOINT")


def node_bus(args: argparse.Namespace, stop: threading.Event) -> Bus | None:
    """Open the bus that the flags of `add_node_flags` ask for.

    A robot that dials a router waits for it, before its control loop starts. None if `stop` was set
    first.
    """
    if args.zenoh_config:
        config = renewed_file(args.zenoh_config, operators_file(args))
        return Bus.when_reachable(config, stop)
    bus = Bus(node_config([args.listen], args.connect or []))
    # A duplicate robot id can be detected only once the other nodes are connected.
    if args.connect and not bus.wait_for_peer(_PATIENCE_S):
        _LOG.warning("no answer from %s yet", ", ".join(args.connect))
    return bus


def node_id(args: argparse.Namespace, default: str) -> str:
    """Return the robot id: from `--id`, the name behind a router, or `default`.

    Raises:
        TwinError: If the router's rules do not allow the id.
    """
    own = from_file(args.zenoh_config).robot if args.zenoh_config else None
    if own is not None and args.id not in (None, own):
        raise TwinError(f"--id: {args.zenoh_config} is for '{own}', and no other id is allowed")
    return args.id or own or default


def add_client_flags(made: argparse.ArgumentParser) -> None:
    """Add the bus flags of a client: `--connect` and `--zenoh-config`."""
    text = f"where a robot listens, may be repeated; default {DEFAULT_ENDPOINT}"
    flags.add(made, "--connect", text, metavar="ENDPOINT", repeated=True)
    made.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, for TLS and access")


def add_adapter_flags(made: argparse.ArgumentParser, operator: str) -> None:
    """Add the flags of an adapter to other tools: `--robot`, `--operator` and `--view-only`."""
    text = "show this robot only; may be repeated; default: all, up to 16"
    flags.add(made, "--robot", text, metavar="ID", repeated=True)
    text = f"name on the bus before `-` and 8 digits; default {operator}, or the certificate's"
    flags.add(made, "--operator", text, default=operator, metavar="NAME")
    made.add_argument("--view-only", action="store_true", help="no cmd_vel and no services")


def adapter_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of an adapter that the flags of `add_adapter_flags` ask for.

    The name and the right to drive come from the certificate, if there is one.
    """
    identity = certificate(args)
    may_drive = identity is None or identity.role is Role.OPERATOR
    return {
        "operator": topics.checked(args.operator) if identity is None else identity.name,
        "may_drive": may_drive and not args.view_only,
        "only": [topics.checked(robot) for robot in args.robot],
    }


def add_recordings_flags(made: argparse.ArgumentParser, name: str) -> None:
    """Add the flags of a folder of recordings: its path, called `name`, and `--keep-gb`."""
    # Late, because it needs the extra `record`.
    from tsd_twin.recording.folder import DEFAULT_GB, LEAST_GB, default_folder

    text = f"folder of the recordings; default {default_folder(Path('~'))}"
    flags.add(made, name, text, Path, metavar="FOLDER")
    text = f"limit of the folder, the oldest files are removed; default {DEFAULT_GB:g}"
    flags.add(made, "--keep-gb", text, flags.number(LEAST_GB), DEFAULT_GB, "GB")


def add_host_flags(made: argparse.ArgumentParser, port: int, of: str = "") -> None:
    """Add `--host` and `--port` of a web server."""
    flags.add(made, "--host", "address to listen on", default="127.0.0.1")
    flags.add(made, "--port", f"{of}default {port}; 0 is a free one", flags.PORT, port)


def add_tls_flags(made: flags.Container, clients: str) -> None:
    """Add the flags of a web server that other machines reach."""
    made.add_argument("--tls-cert", type=Path, metavar="FILE", help="certificate chain in PEM")
    made.add_argument("--tls-key", type=Path, metavar="FILE", help="its private key")
    text = f"a name that {clients} know it by, beside those in the certificate"
    flags.add(made, "--allow-host", text, flags.host_name, metavar="NAME[:PORT]", repeated=True)


def tls(args: argparse.Namespace) -> tuple[SSLContext | None, list[str]]:
    """Return the TLS context of `add_tls_flags`, or None, and all names of the server.

    Raises:
        TwinError: If a flag requires another, or a file cannot be used.
    """
    if (args.tls_cert is None) != (args.tls_key is None):
        raise TwinError("--tls-cert and --tls-key go together: name both, or neither")
    if args.tls_cert is None:
        return None, args.allow_host
    # Late, because it needs the extra `tls`.
    from tsd_twin.security.web_access import certificate_host_names, server_tls_context

    context = server_tls_context(args.tls_cert, args.tls_key)
    return context, [*args.allow_host, *certificate_host_names(args.tls_cert)]


def url(scheme: str, host: str, port: int) -> str:
    """Return the URL of a server on this machine, without a path."""
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"


def client_bus(args: argparse.Namespace) -> Bus:
    """Open the bus that the flags of `add_client_flags` ask for."""
    if args.zenoh_config:
        return Bus(renewed_file(args.zenoh_config))
    return Bus(client_config(args.connect or [DEFAULT_ENDPOINT]))


def client_bus_when_reachable(args: argparse.Namespace, stop: threading.Event) -> Bus | None:
    """Open the same bus; behind a router, once it is there, or None if `stop` was set first."""
    if args.zenoh_config:
        return Bus.when_reachable(renewed_file(args.zenoh_config), stop)
    return client_bus(args)


def renewed_file(path: str, operators: Path | None = None) -> Config:
    """Load a Zenoh configuration, and keep its certificate valid if it names a place to renew it.

    `operators` is a robot's list of operators, which is kept current, too.

    Raises:
        TwinError: If the configuration or its address of the authority is invalid.
    """
    config = from_file(path)
    if config.renewal and config.certificate and config.key and config.authority:
        # Late, because it needs the extra `tls`, without which a robot still runs.
        try:
            from tsd_twin.security.authority_client import ClientFiles
            from tsd_twin.security.renewal import CertificateRenewal
        except MissingExtraError as error:
            _LOG.warning("%s is not renewed: %s", config.certificate, error)
            return config
        own = ClientFiles(config.certificate, config.key)
        renewal = CertificateRenewal(config.renewal, own, config.authority, operators)
        stop = threading.Event()  # The thread ends with the process.
        threading.Thread(target=renewal.run, args=(stop,), daemon=True, name="renewal").start()
    return config


def certificate(args: argparse.Namespace) -> BusIdentity | None:
    """Identity in the certificate of `--zenoh-config`, None without a certificate."""
    file = from_file(args.zenoh_config).certificate if args.zenoh_config else None
    if file is None:
        return None
    # Late, because it needs the extra `tls`.
    from tsd_twin.security.key_folder import certificate_identity

    return certificate_identity(file)


def stop_event(args: argparse.Namespace) -> threading.Event:
    """Event that SIGINT and SIGTERM set, and with `--until-eof` the end of the input."""
    stop = threading.Event()

    def handle(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    if args.until_eof:
        threading.Thread(target=_wait_for_eof, args=(stop,), daemon=True).start()
    return stop


def _wait_for_eof(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    stop.set()


def say_ready(what: str) -> None:
    """Print the line `ready: ...` with the address of the program in service."""
    print(f"ready: {what}", flush=True)  # noqa: T201  The line is the interface of a program.


def run(made: argparse.ArgumentParser, body: Callable[[argparse.Namespace], None]) -> None:
    """Parse the flags and run a program; a `TwinError` ends it with a one-sentence message.

    The exit code is 2 if an extra is missing, else 1.
    """
    args = made.parse_args()
    gc.freeze()  # Modules live as long as the process: each collection, and the end, is shorter.
    try:
        with _logging(args):
            body(args)
    except MissingExtraError as error:
        made.exit(2, f"{made.prog}: {error}\n")
    except TwinError as error:
        sys.exit(f"{made.prog}: {error}")


@contextlib.contextmanager
def _logging(args: argparse.Namespace) -> Generator[None]:
    """Log to stderr, and to a file on a separate thread: a slow disk must not delay a robot.

    Raises:
        TwinError: If the file cannot be written.
    """
    layout = "%(asctime)s %(name)s: %(message)s"
    level = logging.INFO if args.verbose else logging.WARNING
    logging.basicConfig(level=level, format=layout, stream=sys.stderr)
    if args.log_file is None:
        yield
        return
    try:
        file = RotatingFileHandler(args.log_file, maxBytes=_LOG_BYTES, backupCount=_LOG_PARTS)
    except OSError as error:
        raise TwinError(f"the log cannot be written: {error}") from error
    file.setFormatter(logging.Formatter(layout))
    root, lines = logging.getLogger(), SimpleQueue[logging.LogRecord]()
    for handler in root.handlers:
        handler.setLevel(level)
    root.setLevel(logging.INFO)
    queued = QueueHandler(lines)
    root.addHandler(queued)
    listener = QueueListener(lines, file)
    listener.start()
    try:
        yield
    finally:
        root.removeHandler(queued)
        listener.stop()
        file.close()
