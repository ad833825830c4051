"""The recording library over HTTP: list, search, titles, downloads, deletion and undo."""

from __future__ import annotations

import csv
import http.client
import io
import json
import os
import shutil
import zipfile
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pytest
from websockets.exceptions import InvalidStatus

from tests.support.gateway_requests import cookie_of, users
from tests.support.page_client import Page, Site, site
from tests.support.recorded_drives import RecordedDrive
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.gateway.auth import AccessSettings, AuthMiddleware
from tsd_twin.dashboard.gateway.recordings import CHANGES, MAX_DOWNLOADS
from tsd_twin.messages.topics import Service
from tsd_twin.recording import Annotation, add_mark, open_recording
from tsd_twin.recording.mcap_file import RecordingFile

NAME = "tsd-20231114T221320Z.mcap"
OTHER = "Fahrt über den Hof.mcap"
PAGE = "00000000000000a1"
LEASE_TEXT = "00112233445566778899aabbccddeeff"


def drive(path: Path, driver: str) -> Path:
    """Record a drive with two stops and a recorded request."""
    file = RecordingFile(path)
    robot = RecordedDrive(file)
    robot.put_json("twin/tsd/requests", {"service": "arm", "lease": LEASE_TEXT})
    for _ in range(2):
        pilot = robot.get_ready(driver)
        robot.drive(pilot, (0.3, 0.0, 0.2), 0.6)
        robot.ask(Service.STOP)
        robot.wait(1.5)
        assert robot.ask(Service.RESET, lease=pilot.lease).ok
        robot.ask(Service.LEASE, op="release", operator=driver, lease=pilot.lease)
    file.close()
    return path


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("originals")
    add_mark(drive(made / NAME, "alice"), Annotation(1_700_000_001_000_000_000, "Rutschte HIER"))
    drive(made / OTHER, "bob")
    (made / "damaged.mcap").write_bytes(bytes(100) + (made / NAME).read_bytes()[100:])
    return made


@pytest.fixture
def folder(originals: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(originals, tmp_path / "drives"))


@pytest.fixture
def served(folder: Path) -> Generator[Site]:
    auth = AuthMiddleware(AccessSettings(users=users()))
    with site(auth=auth, recordings=folder) as made:
        yield made


class Client:
    """Browser of a user."""

    def __init__(self, served: Site, user: str) -> None:
        self.port, self.cookie = served.port, cookie_of(served.port, user)

    def raw(
        self, method: str, path: str, body: bytes | None = None, **headers: str | None
    ) -> tuple[http.client.HTTPResponse, bytes]:
        """Send a request with the page's origin; None removes a header."""
        wanted = {"Cookie": self.cookie, "Origin": f"http://127.0.0.1:{self.port}"}
        sent = wanted | {name.replace("_", "-"): value for name, value in headers.items()}
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)) as one:
            one.request(method, path, body, {k: v for k, v in sent.items() if v is not None})
            answer = one.getresponse()
            return answer, answer.read()

    def ask(self, method: str, path: str, body: Any = None, **headers: str | None) -> Any:
        """Return the status and the decoded reply."""
        data = None if body is None else json.dumps(body).encode()
        answer, found = self.raw(method, path, data, **headers)
        return answer.status, json.loads(found)

    def rows(self, query: str = "") -> list[dict[str, Any]]:
        status, rows = self.ask("GET", f"/recordings?q={quote(query)}")
        assert status == 200
        return rows

    def names(self, query: str = "") -> list[str]:
        return [row["name"] for row in self.rows(query)]


@pytest.fixture
def alice(served: Site) -> Client:
    return Client(served, "alice")


@pytest.fixture
def guest(served: Site) -> Client:
    return Client(served, "guest")


def at(name: str, what: str = "") -> str:
    return f"/recordings/{quote(name, safe='')}{what}"


def read_completely(served: Site, client: Client) -> list[dict[str, Any]]:
    """Return the rows once all details are read, of which the page is notified."""
    with served.page(PAGE, user="alice", cookie=client.cookie) as page:
        for _ in range(20):
            before = len(page.all("recordings_changed"))
            rows = client.rows()
            if not any(row["details_pending"] for row in rows):
                return rows
            page.until(lambda count=before: len(page.all("recordings_changed")) > count)
    raise AssertionError("the details were not read")


def test_a_row_has_what_happened_in_the_recording(
    served: Site, guest: Client, folder: Path
) -> None:
    rows = {row["name"]: row for row in read_completely(served, guest)}
    row, details = rows[NAME], rows[NAME]["details"]
    assert set(rows) == {NAME, OTHER}
    assert (details["drivers"], details["stops"], details["faults"]) == (["alice"], 2, 0)
    assert rows[OTHER]["details"]["drivers"] == ["bob"]
    assert (row["robots"], row["marks"], row["notes"]) == (["tsd"], 1, ["Rutschte HIER"])
    assert (row["writing"], row["title"]) == (False, "")
    assert row["size_bytes"] == (folder / NAME).stat().st_size
    assert details["paths"] == guest.ask("GET", at(NAME, "/path"))[1]
    (lanes,) = guest.ask("GET", at(NAME, "/lanes"))[1]
    assert lanes["end_s"] == pytest.approx(row["duration_s"], abs=0.06)
    assert {"alice", None} == set(lanes["drivers"])
    assert {"ready", "driving", "stopped"} <= set(lanes["modes"])


def test_details_are_not_read_again_while_the_file_is_unchanged(
    served: Site, guest: Client, folder: Path
) -> None:
    rows = {row["name"]: row for row in read_completely(served, guest)}
    times = (folder / NAME).stat()
    damaged = bytearray((folder / NAME).read_bytes())
    damaged[1000:2000] = bytes(1000)
    with (folder / NAME).open("r+b") as file:
        file.write(damaged)
    os.utime(folder / NAME, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert {row["name"]: row for row in guest.rows()} == rows


def test_search_finds_names_titles_drivers_marks_and_any_case(
    served: Site, alice: Client, guest: Client
) -> None:
    read_completely(served, guest)
    assert alice.ask("PUT", at(OTHER, "/title"), {"title": "Straße am Fluß"})[0] == 200
    for query, names in {
        "": {NAME, OTHER},
        "rutschte hier": {NAME},
        "hier rutschte ALICE": {NAME},
        "bob": {OTHER},
        "STRASSE": {OTHER},
        "u\u0308ber": {OTHER},
        "20231114": {NAME},
        "tsd": {NAME, OTHER},
        "alice bob": set[str](),
    }.items():
        assert set(guest.names(query)) == names, query
    assert guest.ask("GET", f"/recordings?q={'x' * 101}")[0] == 400


def test_a_title_appears_on_all_pages_and_links_stay_valid(
    served: Site, alice: Client, guest: Client
) -> None:
    with served.page(PAGE, user="guest", cookie=guest.cookie) as page:
        for title, previous in [("試験走行 U\u0308", ""), ("Second", "試験走行 Ü"), ("", "Second")]:
            count = len(page.all("recordings_changed"))
            status, answer = alice.ask("PUT", at(NAME, "/title"), {"title": title})
            assert (status, answer["previous"]) == (200, previous)
            page.until(lambda c=count: len(page.all("recordings_changed")) > c)
            (row,) = [row for row in guest.rows() if row["name"] == NAME]
            assert row["title"] == answer["title"]
    page = Page(served.port, "00000000000000b2", recording=NAME, cookie=guest.cookie)
    page.until(lambda: page.last("timeline"))
    count = len(page.all("recordings_changed"))
    alice.ask("PUT", at(OTHER, "/title"), {"title": "x"})
    page.until(lambda: len(page.all("recordings_changed")) > count)
    page.close()
    for body in (
        {"title": "x" * 41},
        {"title": "a\u202e"},
        {"title": 1},
        {},
        {"title": "", "b": 1},
    ):
        assert alice.ask("PUT", at(NAME, "/title"), body)[0] == 400


def test_a_deletion_is_undone_also_after_a_restart(folder: Path) -> None:
    before = (folder / NAME).read_bytes()
    auth = AuthMiddleware(AccessSettings(users=users()))
    with site(auth=auth, recordings=folder) as first:
        alice = Client(first, "alice")
        status, row = alice.ask("DELETE", at(NAME))
        assert (status, row["name"], row["by"]) == (200, NAME, "alice")
        assert alice.names() == [OTHER]
        with pytest.raises(InvalidStatus) as refused:
            Page(first.port, PAGE, recording=NAME, cookie=alice.cookie)
        assert refused.value.response.status_code == 404
    with site(auth=AuthMiddleware(AccessSettings(users=users())), recordings=folder) as second:
        bob = Client(second, "bob")
        assert bob.ask("GET", "/recordings/trash") == (200, [row])
        restored = bob.ask("POST", f"/recordings/trash/{row['id']}/restore")
        assert restored == (200, {"name": NAME})
        assert bob.ask("GET", "/recordings/trash") == (200, [])
        (found,) = [each for each in bob.rows() if each["name"] == NAME]
        assert found["notes"] == ["Rutschte HIER"]
        again = bob.ask("POST", f"/recordings/trash/{row['id']}/restore")
        assert (again[0], again[1]["code"]) == (404, "not_in_trash")
    assert (folder / NAME).read_bytes() == before


def test_of_simultaneous_requests_one_deletes(served: Site, alice: Client) -> None:
    bob = Client(served, "bob")
    with ThreadPoolExecutor(8) as pool:
        asked = [pool.submit((alice, bob)[i % 2].ask, "DELETE", at(NAME)) for i in range(8)]
    answers = [each.result() for each in asked]
    assert sorted(status for status, _ in answers) == [200] + [404] * 7
    assert len(alice.ask("GET", "/recordings/trash")[1]) == 1


CHANGING: list[tuple[str, str, Any]] = [
    ("PUT", at(NAME, "/title"), {"title": "mine"}),
    ("DELETE", at(NAME), None),
    ("POST", f"/recordings/trash/{'0' * 16}/restore", None),
]


@pytest.mark.parametrize(("method", "path", "body"), CHANGING)
def test_viewers_and_other_sites_change_nothing(
    alice: Client, guest: Client, method: str, path: str, body: Any
) -> None:
    before = guest.rows()
    status, refusal = guest.ask(method, path, body)
    assert (status, refusal["code"]) == (403, "viewer")
    data = None if body is None else json.dumps(body).encode()
    for origin in (None, "null", "http://127.0.0.1:1", "https://elsewhere.example"):
        assert alice.raw(method, path, data, Origin=origin)[0].status == 403
    assert alice.raw(method, path, data, Cookie=None)[0].status == 401
    assert [row["name"] for row in guest.rows()] == [row["name"] for row in before]
    assert {row["title"] for row in guest.rows()} == {""}


def test_the_recording_that_is_written_can_be_named_but_not_deleted(
    alice: Client, folder: Path
) -> None:
    with closing(RecordingFile(folder / "tsd-new.mcap")) as file:
        robot = RecordedDrive(file)
        robot.circle(1)
        file.flush()
        (row,) = [row for row in alice.rows() if row["name"] == "tsd-new.mcap"]
        assert row["writing"]
        status, refusal = alice.ask("DELETE", at("tsd-new.mcap"))
        assert (status, refusal["code"]) == (409, "being_written")
        assert alice.ask("PUT", at("tsd-new.mcap", "/title"), {"title": "now"})[0] == 200
    assert alice.ask("DELETE", at("tsd-new.mcap"))[0] == 200


@pytest.mark.parametrize(
    "name",
    [
        "missing.mcap",
        "..",
        "../outside.mcap",
        "/etc/passwd",
        ".",
        "%00.mcap",
        "a\n.mcap",
        "trash/x",
    ],
)
def test_hostile_names_reach_no_file(alice: Client, folder: Path, name: str) -> None:
    outside = folder.parent / "outside.mcap"
    shutil.copy(folder / NAME, outside)
    for method, path, body in (
        ("GET", at(name, "/path"), None),
        ("GET", at(name, "/lanes"), None),
        ("GET", at(name, "/download"), None),
        ("GET", at(name, "/export?as=mcap"), None),
        ("PUT", at(name, "/title"), b'{"title": "x"}'),
        ("DELETE", at(name), None),
    ):
        assert alice.raw(method, path, body)[0].status == 404
    assert outside.is_file()
    assert not (folder.parent / "outside.title").exists()


def test_a_file_whose_name_is_not_text_does_not_disturb_the_list(
    alice: Client, folder: Path
) -> None:
    shutil.copy(folder / NAME, folder / os.fsdecode(b"\xff.mcap"))
    shutil.copy(folder / NAME, folder / "line\nfeed.mcap")
    assert set(alice.names()) == {NAME, OTHER}


def test_a_download_is_the_file_or_the_range_asked_for(alice: Client, folder: Path) -> None:
    data = (folder / NAME).read_bytes()
    answer, body = alice.raw("GET", at(NAME, "/download"))
    assert (answer.status, body) == (200, data)
    etag = answer.headers["ETag"]
    end = len(data)
    for asked, start, stop in (
        ("bytes=0-9", 0, 10),
        ("bytes=100-", 100, end),
        ("bytes=-7", end - 7, end),
        (f"bytes={end - 1}-{end + 5}", end - 1, end),
    ):
        answer, body = alice.raw("GET", at(NAME, "/download"), Range=asked, If_Range=etag)
        assert (answer.status, body) == (206, data[start:stop])
        assert answer.headers["Content-Range"] == f"bytes {start}-{stop - 1}/{end}"
    answer, _ = alice.raw("GET", at(NAME, "/download"), Range=f"bytes={len(data)}-")
    assert answer.status == 416
    answer, body = alice.raw("GET", at(NAME, "/download"), Range="bytes=0-9", If_Range='"old"')
    assert (answer.status, body) == (200, data)
    answer, body = alice.raw("HEAD", at(NAME, "/download"))
    assert (int(answer.headers["Content-Length"]), body) == (len(data), b"")


def test_a_downloaded_file_is_named_by_its_title(alice: Client) -> None:
    alice.ask("PUT", at(NAME, "/title"), {"title": 'a/..\\b"c 試験 U\u0308%'})
    answer, _ = alice.raw("HEAD", at(NAME, "/download"))
    plain, _, full = answer.headers["Content-Disposition"].partition("; filename*=UTF-8''")
    assert unquote(full) == "a_.._b_c 試験 Ü%.mcap"
    assert plain == 'attachment; filename="a_.._b_c __ __.mcap"'
    answer, _ = alice.raw("HEAD", at(OTHER, "/download"))
    assert quote("Fahrt über den Hof.mcap", safe="") in answer.headers["Content-Disposition"]


def texts(path: Path) -> str:
    """Return all messages of a recording as text."""
    return " ".join(str(each.value) for each in open_recording(path).messages("requests"))


def test_viewers_export_without_lease_ids_and_do_not_download(
    guest: Client, alice: Client, tmp_path: Path
) -> None:
    assert guest.raw("GET", at(NAME, "/download"))[0].status == 403
    files = {
        "all.mcap": alice.raw("GET", at(NAME, "/download")),
        "part.mcap": guest.raw("GET", at(NAME, "/export?as=mcap&to=1.5")),
    }
    found: dict[str, str] = {}
    for name, (answer, body) in files.items():
        assert answer.status == 200
        (tmp_path / name).write_bytes(body)
        found[name] = texts(tmp_path / name)
    assert LEASE_TEXT in found["all.mcap"]
    assert LEASE_TEXT not in found["part.mcap"]
    assert "arm" in found["part.mcap"]
    assert 1.0 < open_recording(tmp_path / "part.mcap").duration_s <= 1.5


def test_tables_are_exported_without_lease_ids(guest: Client) -> None:
    answer, body = guest.raw("GET", at(NAME, "/export?as=csv"))
    assert answer.headers["Content-Type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        tables = {name: archive.read(name).decode() for name in archive.namelist()}
    assert len(list(csv.DictReader(io.StringIO(tables["tsd_state_odom.csv"])))) > 50
    assert "arm" in tables["tsd_requests.csv"]
    assert LEASE_TEXT not in "".join(tables.values())


def test_a_page_is_exported_that_plays_the_part(guest: Client) -> None:
    answer, body = guest.raw("GET", at(NAME, "/export?as=html&from=1&to=1.2"))
    assert answer.status == 200
    assert answer.headers["Content-Disposition"].startswith("attachment")
    text = body.decode().split('id="tsd-recording">')[1].split("</script>")[0]
    assert json.loads(text)["duration_s"] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (at("damaged.mcap", "/export?as=csv"), 422),
        (at(NAME, "/export?as=csv&from=50"), 422),
        (at(NAME, "/export?as=csv&robot=--help"), 422),
        (at(NAME, "/export?as=exe"), 400),
        (at(NAME, "/export?as=csv&from=x"), 400),
        (at(NAME, "/export?as=csv&from=nan"), 400),
        (at(NAME, "/export"), 400),
    ],
)
def test_an_export_that_cannot_be_made_is_refused_in_a_sentence(
    guest: Client, path: str, status: int
) -> None:
    found, refusal = guest.ask("GET", path)
    assert found == status
    assert refusal["text"]
    assert "Traceback" not in refusal["text"]


def test_other_sites_start_no_downloads(alice: Client) -> None:
    for site_name in ("cross-site", "same-site"):
        for what in ("/download", "/export?as=csv"):
            answer, _ = alice.raw("GET", at(NAME, what), Origin=None, Sec_Fetch_Site=site_name)
            assert answer.status == 403


def test_a_flood_of_changes_is_refused(alice: Client) -> None:
    burst = round(CHANGES.burst)
    found = [alice.raw("DELETE", at("missing.mcap"))[0].status for _ in range(burst + 10)]
    assert found[:burst] == [404] * burst
    assert 429 in found[burst:]


def test_a_login_has_few_downloads_at_a_time(served: Site, alice: Client, folder: Path) -> None:
    """The first clients read no data, so their downloads do not finish."""
    with (folder / "large.mcap").open("wb") as file:
        file.truncate(200_000_000)
    waiting: list[http.client.HTTPConnection] = []
    try:
        for _ in range(MAX_DOWNLOADS):
            one = http.client.HTTPConnection("127.0.0.1", alice.port, timeout=PATIENCE_S)
            waiting.append(one)
            one.request("GET", at("large.mcap", "/download"), headers={"Cookie": alice.cookie})
            assert one.getresponse().status == 200
        assert alice.raw("GET", at(NAME, "/download"))[0].status == 429
        assert Client(served, "bob").raw("GET", at(NAME, "/download"))[0].status == 200
    finally:
        for one in waiting:
            one.close()
