"""nginx with the configuration that docs/access.md shows."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from tests.app.conftest import PATIENCE_S
from tests.support.markdown_pages import code, page

_MAIN = """daemon off;
master_process off;
pid {folder}/nginx.pid;
error_log stderr warn;
events {{}}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {folder}/site.conf;
}}
"""


def executable() -> str:
    """Return the nginx that `scripts/ensure_servers` looks for."""
    found = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
    assert found, "there is no nginx: run scripts/ensure_servers"
    return found


@dataclass
class Proxy:
    """nginx on a free port, started once its upstream is known."""

    folder: Path
    keys: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    def pass_on_to(self, url: str) -> None:
        """Start, with the text of the docs but for ports and files."""
        (text,) = code(page("access.md"), "nginx")
        changes = {
            "listen 443 ssl": f"listen 127.0.0.1:{self.port} ssl",
            "127.0.0.1:8080": urlsplit(url).netloc,
            "/etc/ssl/robots.pem": str(self.keys / "robot.pem"),
            "/etc/ssl/robots.key": str(self.keys / "robot.key"),
            # A redirect of nginx's own names the port, unless it is the usual one.
            "return 301 /twin/": f"return 301 https://$host:{self.port}/twin/",
        }
        for before, after in changes.items():
            assert text.count(before) == 1, before
            text = text.replace(before, after)
        (self.folder / "site.conf").write_text(text)
        main = self.folder / "nginx.conf"
        main.write_text(_MAIN.format(folder=self.folder))
        self.process = subprocess.Popen(
            [executable(), "-p", str(self.folder), "-e", "stderr", "-c", str(main)]
        )
        end_s = time.monotonic() + PATIENCE_S
        while True:
            assert self.process.poll() is None, "nginx has ended"
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            assert time.monotonic() < end_s, "nginx does not listen"
            time.sleep(0.02)


@contextmanager
def nginx(folder: Path, keys: Path) -> Generator[Proxy]:
    """Yield a proxy that is started later, since it and the dashboard name each other."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        made = Proxy(folder, keys, probe.getsockname()[1])
    try:
        yield made
    finally:
        if made.process is not None:
            made.process.terminate()
            made.process.wait(PATIENCE_S)
