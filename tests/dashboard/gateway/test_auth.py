"""Access to the gateway, and the end of open sessions when access ends."""

from __future__ import annotations

import time
from collections.abc import Generator

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.support.gateway_requests import PHRASE, ask, cookie_of, limiting, log_in, users
from tests.support.page_client import Site, site
from tests.support.viser_client import CAMERA, ViserClient
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.gateway.auth import LOGGED_OUT_CODE, AccessSettings, AuthMiddleware
from tsd_twin.dashboard.sessions.principal import DEFAULT_IDENTITY, Principal, operator_name
from tsd_twin.errors import TwinError
from tsd_twin.security import BusIdentity, Role
from tsd_twin.security.users import ABSOLUTE_S

PAGE = "0123456789abcdef"
OTHER = "fedcba9876543210"
EVERYTHING = ["/healthz", "/page.js", "/page.css", f"/teleop?page={PAGE}"]
EVERYTHING += [
    f"/viser/{PAGE}",
    "/nothing",
    "/recordings",
    "/recordings/trash",
    "/recordings/a.mcap/path",
    "/recordings/a.mcap/download",
    "/recordings/a.mcap/export?as=csv",
    f"/recorded/a.mcap/{PAGE}",
]
VISER = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def served(server: viser.ViserServer) -> Generator[Site]:
    with site(server.get_port(), AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


@pytest.fixture
def fresh() -> Generator[Site]:
    """A site without failed logins so far."""
    with site(auth=AuthMiddleware(AccessSettings(users=users()))) as made:
        yield made


@pytest.mark.parametrize("path", EVERYTHING)
@pytest.mark.parametrize("cookie", ["", "made-up", "x" * 500])
def test_without_a_login_there_is_nothing_but_the_login_page(
    served: Site, path: str, cookie: str
) -> None:
    headers = {}
    if cookie:
        headers["Cookie"] = f"{cookie_of(served.port, 'alice').partition('=')[0]}={cookie}"
    answer, body = ask(served.port, "GET", path, **headers)
    assert (answer.status, body) == (401, "Log in first.")
    answer, _ = ask(served.port, "GET", "/", **headers)
    assert (answer.status, answer.headers["Location"]) == (302, "login")
    answer, page = ask(served.port, "GET", "/login", **headers)
    assert answer.status == 200
    assert 'type="password"' in page
    assert "<script" not in page
    assert answer.headers["Cache-Control"] == "no-store"


@pytest.mark.parametrize("path", [f"/teleop?page={PAGE}", f"/viser/{PAGE}"])
def test_a_socket_without_a_login_is_refused_before_it_is_one(served: Site, path: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{served.port}{path}", subprotocols=[VISER])
    assert refused.value.response.status_code == 401


def test_the_cookie_is_for_this_gateway_alone_and_no_script_reads_it(served: Site) -> None:
    answer, _ = log_in(served.port, "alice")
    assert (answer.status, answer.headers["Location"]) == (303, "./")
    pair, *flags = (part.strip().lower() for part in answer.headers["Set-Cookie"].split(";"))
    assert {"httponly", "samesite=strict", "path=/"} <= set(flags)
    assert not any(flag.startswith(("domain", "max-age", "expires")) for flag in flags)
    assert len(pair.partition("=")[2]) >= 43
    cookie = cookie_of(served.port, "alice")
    assert ask(served.port, "GET", "/", Cookie=cookie)[0].status == 200
    assert ask(served.port, "GET", "/login", Cookie=cookie)[0].status == 303


@pytest.mark.parametrize("path", ["/login", "/logout"])
@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", ""])
def test_a_form_of_a_foreign_page_is_refused(served: Site, path: str, origin: str) -> None:
    cookie = cookie_of(served.port, "alice")
    answer, _ = ask(
        served.port, "POST", path, f"name=alice&password={PHRASE}", Origin=origin, Cookie=cookie
    )
    assert answer.status == 403
    assert "Set-Cookie" not in answer.headers
    assert ask(served.port, "GET", "/healthz", Cookie=cookie)[0].status == 200


def test_what_is_typed_is_shown_again_as_text_and_no_password_is(fresh: Site) -> None:
    answer, page = log_in(fresh.port, '"><script>', "hunter2 hunter2")
    assert answer.status == 401
    assert "Name or password is wrong." in page
    assert "<script" not in page
    assert "hunter2" not in page


def test_wrong_passwords_are_slowed_down_with_a_sentence_and_also_for_who_is_right() -> None:
    # The shipped limits with longer delays, so that a slow machine cannot wait them out.
    with site(auth=limiting(free=5, first_s=500.0)) as fresh:
        for name in ("alice", "nobody", "alice", "alice", "bob"):
            assert log_in(fresh.port, name, "wrong wrong wrong")[0].status == 401
        for name in ("alice", "guest"):
            answer, page = log_in(fresh.port, name)
            assert answer.status == 429
            assert 0 < int(answer.headers["Retry-After"]) <= 500
            assert "Too many wrong passwords: wait 9 min" in page


def test_a_login_that_is_there_stays_while_others_guess(fresh: Site) -> None:
    cookie = cookie_of(fresh.port, "alice")
    for _ in range(6):
        log_in(fresh.port, "alice", "wrong wrong wrong")
    assert ask(fresh.port, "GET", "/healthz", Cookie=cookie)[0].status == 200


def test_who_logs_in_drives_under_her_name(served: Site) -> None:
    with served.page(PAGE, user="alice", cookie=cookie_of(served.port, "alice")) as page:
        page.make_ready()
        page.drive()
        assert page.state["status"]["lease"]["holder"] == f"alice-{PAGE[:8]}"
        assert page.last("welcome")["user"] == "alice"
        page.holds = None
        page.until(lambda: page.mode == "ready")


def test_who_logs_out_lets_go_of_the_robot_and_loses_all_that_was_open(served: Site) -> None:
    cookie = cookie_of(served.port, "alice")
    with (
        served.page(OTHER, user="guest", cookie=cookie_of(served.port, "guest")) as witness,
        served.page(PAGE, user="alice", cookie=cookie) as page,
        connect(
            f"ws://127.0.0.1:{served.port}/viser/{PAGE}",
            subprotocols=[VISER],
            additional_headers={"Cookie": cookie},
            max_size=None,
        ) as scene,
    ):
        viewer = ViserClient(scene)
        page.make_ready()
        page.drive()
        assert ask(served.port, "POST", "/logout", Cookie=cookie)[0].status == 303
        page.until(lambda: page.closed == LOGGED_OUT_CODE)
        viewer.until(lambda: viewer.closed)
        witness.until(lambda: witness.mode == "ready")
        witness.until(lambda: witness.state["status"]["lease"]["holder"] is None)
        assert ask(served.port, "GET", "/healthz", Cookie=cookie)[0].status == 401
        viewer.join()


def test_a_login_whose_time_is_over_lets_go_of_the_robot() -> None:
    passed_s = 0.0
    door = AuthMiddleware(AccessSettings(users=users()), now_s=lambda: time.monotonic() + passed_s)
    with site(auth=door) as made:
        witness = cookie_of(made.port, "guest")
        with made.page(PAGE, user="alice", cookie=cookie_of(made.port, "alice")) as page:
            page.make_ready()
            page.drive()
            passed_s = ABSOLUTE_S
            page.until(lambda: page.closed == LOGGED_OUT_CODE)
        assert ask(made.port, "GET", "/healthz", Cookie=witness)[0].status == 401
        with made.page(OTHER, user="guest", cookie=cookie_of(made.port, "guest")) as later:
            later.until(lambda: later.mode == "ready")
            later.until(lambda: later.state["status"]["lease"]["holder"] is None)


@pytest.mark.parametrize("name", ["guest", "eve"])
def test_a_viewer_sees_everything_and_every_request_is_refused(served: Site, name: str) -> None:
    with served.page(PAGE, user=name, cookie=cookie_of(served.port, name)) as page:
        page.until(lambda: page.state)
        welcome = page.last("welcome")
        assert (welcome["role"], welcome["may_stop"]) == ("viewer", name == "eve")
        before = page.mode
        for kind in ("arm", "disarm", "reset"):
            assert not page.answer(kind, t=kind)["ok"]
        assert not page.answer("wheel_speed", t="wheel_speed", cruise_speed_rpm=3000.0)["ok"]
        assert page.take(take_over=True)["why"]["code"] == "viewer"
        page.holds = {"vx": 0.5, "vy": 0.0, "omega": 0.0}
        for _ in range(20):
            count = len(page.all("state"))
            page.until(lambda count=count: len(page.all("state")) > count)
        assert page.mode == before
        if name == "guest":
            assert page.answer("stop", t="stop")["why"]["code"] == "viewer"
            assert page.mode == before


def test_a_viewer_may_stop_when_it_was_given(fresh: Site) -> None:
    with fresh.page(PAGE, user="eve", cookie=cookie_of(fresh.port, "eve")) as page:
        page.until(lambda: page.state)
        assert page.answer("stop", t="stop")["ok"]
        page.until(lambda: page.mode == "stopped")


def test_what_a_viewer_says_to_viser_has_no_effect(server: viser.ViserServer, served: Site) -> None:
    """Sent directly to the socket; an operator's messages prove that they would have an effect."""
    ball = server.scene.add_icosphere("/w/r/secret/x", 0.1)
    heard: list[str] = []

    @ball.on_click
    async def _(event: viser.SceneNodePointerEvent[viser.IcosphereHandle]) -> None:
        heard.append(event.event)

    click = {
        "type": "SceneNodeClickMessage",
        "name": "/w/r/secret/x",
        "instance_index": None,
        "ray_origin": [1.0, 0.0, 0.0],
        "ray_direction": [-1.0, 0.0, 0.0],
        "screen_pos": [0.5, 0.5],
    }
    for name, expected in (("guest", 0), ("alice", 1)):
        socket = connect(
            f"ws://127.0.0.1:{served.port}/viser/{OTHER}",
            subprotocols=[VISER],
            additional_headers={"Cookie": cookie_of(served.port, name)},
            max_size=None,
        )
        viewer = ViserClient(socket)
        viewer.send(CAMERA)
        viewer.until(lambda viewer=viewer: viewer.node("/w/r/secret/x"))
        viewer.send(click)
        clients = server.get_clients()
        looking = CAMERA | {"position": [4.0, 4.0, 4.0]}
        viewer.send(looking)  # Once it arrives, all earlier messages have been read.
        end_s = time.monotonic() + PATIENCE_S
        while not any(c.camera.position[0] == 4.0 for c in clients.values()):
            assert time.monotonic() < end_s, "the camera of a viewer is heard"
            clients = server.get_clients()
            time.sleep(0.01)
        viewer.join()
        assert len(heard) == expected
    ball.remove()


def test_the_page_of_one_login_is_not_that_of_another(served: Site) -> None:
    with served.page(PAGE, user="alice", cookie=cookie_of(served.port, "alice")) as page:
        page.until(lambda: page.state)
        for path in (f"/teleop?page={PAGE}", f"/teleop/lane?page={PAGE}", f"/viser/{PAGE}"):
            with pytest.raises(InvalidStatus) as refused:
                connect(
                    f"ws://127.0.0.1:{served.port}{path}",
                    additional_headers={"Cookie": cookie_of(served.port, "bob")},
                )
            assert refused.value.response.status_code == 403
        assert page.closed is None


@pytest.mark.parametrize(
    ("rules", "host", "sentence"),
    [
        (AccessSettings(), "0.0.0.0", "has no login"),
        (AccessSettings(), "192.0.2.1", "has no login"),
        (AccessSettings(proxy="127.0.0.1"), "127.0.0.1", "has no login"),
        (AccessSettings(users=users()), "0.0.0.0", "--tls-cert"),
        (AccessSettings(users=users()), "::", "--tls-cert"),
        (AccessSettings(users=users(), proxy="127.0.0.1"), "0.0.0.0", "--behind-proxy"),
        (AccessSettings(BusIdentity("x" * 20, Role.OPERATOR), users()), "127.0.0.1", "too long"),
    ],
)
def test_what_would_let_in_everybody_is_refused(
    rules: AccessSettings, host: str, sentence: str
) -> None:
    with pytest.raises(TwinError, match=sentence):
        rules.check(host)


def test_a_certificate_on_the_bus_bounds_what_its_users_may() -> None:
    door = AuthMiddleware(AccessSettings(BusIdentity("desk", Role.VIEWER), users()))
    with site(auth=door) as made:
        cookie = cookie_of(made.port, "alice")
        with made.page(PAGE, user="desk-alice", cookie=cookie) as page:
            page.until(lambda: page.state)
            assert page.last("welcome")["operator"] == f"desk-alice-{PAGE[:8]}"
            assert page.take()["why"]["code"] == "viewer"


DESK = BusIdentity("desk", Role.OPERATOR)


@pytest.mark.parametrize(
    ("owner", "typed", "name"),
    [
        (DEFAULT_IDENTITY, "anna", "anna"),
        (DEFAULT_IDENTITY, "", "web"),
        (DEFAULT_IDENTITY, "x" * 24, "x" * 20),
        (DEFAULT_IDENTITY, "Änna B.\n", "anna-b"),
        (DEFAULT_IDENTITY, "a/b", "a-b"),
        (DEFAULT_IDENTITY, "Ольга", "web"),
        (DESK, "anna", "desk"),
        (DESK, "Ольга", "desk"),
    ],
)
def test_an_operator_id_spells_a_typed_name_as_far_as_the_bus_permits_it(
    owner: BusIdentity, typed: str, name: str
) -> None:
    assert operator_name(Principal(owner, may_stop=True), typed) == name


def test_a_name_in_another_script_is_shown_and_not_in_the_id() -> None:
    with site() as made, made.page(f"{PAGE}&name=%D0%9E%D0%BB%D1%8C%D0%B3%D0%B0") as page:
        welcome = page.until(lambda: page.last("welcome"))
        assert (welcome["name"], welcome["operator"]) == ("Ольга", f"web-{PAGE[:8]}")


def test_a_name_is_typed_where_there_are_no_logins_only(served: Site) -> None:
    with site() as made, made.page(f"{PAGE}&name=anna", user="anna") as page:
        assert page.until(lambda: page.last("welcome"))["operator"] == f"anna-{PAGE[:8]}"
        page.until(lambda: page.state)
        assert page.take()["ok"]
        page.until(lambda: page.state["status"]["lease"]["holder"] == page.operator)
    with served.page(f"{PAGE}&name=bob", cookie=cookie_of(served.port, "alice")) as page:
        assert page.until(lambda: page.last("welcome"))["operator"] == f"alice-{PAGE[:8]}"
