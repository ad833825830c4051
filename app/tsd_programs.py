"""Entry points of the installed programs.

A program that lacks an extra names it in one sentence instead of failing at an import.
"""

from __future__ import annotations

import importlib
import sys
from functools import partial

from tsd_twin.errors import MissingExtraError, check_extra


def _run(module: str, extra: str = "") -> None:
    """Run a program; exit with code 2 if a package of its extra is not installed."""
    name = module.replace("_", "-")
    if extra:
        try:
            check_extra(name, extra)
        except MissingExtraError as error:
            print(error, file=sys.stderr)
            sys.exit(2)
    importlib.import_module(module).main()


demo = partial(_run, "tsd_demo", "dashboard")
mock = partial(_run, "tsd_mock")
bridge = partial(_run, "tsd_bridge", "bridge")
dashboard = partial(_run, "tsd_dashboard", "dashboard")
certs = partial(_run, "tsd_certs", "tls")
users = partial(_run, "tsd_users", "dashboard")
link = partial(_run, "tsd_link")
lab = partial(_run, "tsd_lab", "lab")
record = partial(_run, "tsd_record", "record")
replay = partial(_run, "tsd_replay", "record")
foxglove = partial(_run, "tsd_foxglove", "foxglove")
ros = partial(_run, "tsd_ros", "ros")
