"""Who is let in, and what every reply says."""

import pytest
from support.workbench import OWN, PORT

from skhoid.lab.workbench.server import HEADERS, Keys


@pytest.fixture
def stranger(begun):
    """A client without a cookie, and the token."""
    page = begun()
    page.client.cookies.clear()
    return page.client, page.keys


def test_the_token_becomes_a_cookie_and_leaves_the_address(stranger):
    client, keys = stranger
    reply = client.get("/", params={"token": keys.token}, follow_redirects=False)
    assert reply.status_code == 303
    assert reply.headers["location"] == "/"
    cookie = reply.headers["set-cookie"]
    assert keys.token not in cookie
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    page = client.get("/")
    assert page.status_code == 200
    assert "<title>skhoid workbench</title>" in page.text


@pytest.mark.parametrize(
    "path", ["/", "/api/opening", "/static/start.js", "/api/events", "/nothing"]
)
def test_nothing_without_a_token(stranger, path):
    client, _ = stranger
    assert client.get(path).status_code == 403
    assert "token" in client.get(path).json()["message"]


@pytest.mark.parametrize("token", ["", "wrong", "\N{BLACK STAR}"])
def test_no_other_token(stranger, token):
    client, keys = stranger
    assert client.get("/", params={"token": token}).status_code == 403
    both = client.get(f"/?token={token}&token={keys.token}")
    assert both.status_code == 403


def test_the_token_opens_the_page_alone(stranger):
    client, keys = stranger
    assert client.get("/api/opening", params={"token": keys.token}).status_code == 403


def test_a_program_may_send_the_token_as_a_header(stranger):
    client, keys = stranger
    own = {"authorization": f"Bearer {keys.token}"}
    assert client.get("/api/opening", headers=own).status_code == 200
    assert client.get("/api/opening", headers={"authorization": "Bearer no"}).status_code == 403


def test_a_wrong_cookie_is_none(begun):
    page = begun()
    page.client.cookies.set(f"skhoid-{PORT}", "wrong")
    for text in (f"skhoid-{PORT}=wrong", f"skhoid-{PORT + 1}={page.keys.cookie}", "\x7f;=;="):
        page.client.cookies.clear()
        assert page.client.get("/", headers={"cookie": text}).status_code == 403


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        f"evil.example:{PORT}",
        "127.0.0.1",
        f"127.0.0.1:{PORT + 1}",
        f"0.0.0.0:{PORT}",
    ],
)
def test_another_name_of_this_machine_is_refused(begun, host):
    page = begun()
    assert page.client.get("/", headers={"host": host}).status_code == 421


def test_localhost_is_this_machine(begun):
    page = begun()
    own = {"authorization": f"Bearer {page.keys.token}"}
    host = {"host": f"localhost:{PORT}"}
    assert page.client.get("/", headers=own | host).status_code == 200
    # Both names are ours, and each is another origin.
    mixed = own | host | {"origin": OWN}
    assert page.client.post("/api/state", json={}, headers=mixed).status_code == 403


@pytest.mark.parametrize(
    "origin", ["null", "http://evil.example", f"https://127.0.0.1:{PORT}", "http://127.0.0.1", ""]
)
def test_other_origins_are_refused(begun, origin):
    page = begun()
    for method in ("GET", "POST"):
        reply = page.client.request(method, "/api/opening", headers={"origin": origin})
        assert reply.status_code == 403


@pytest.mark.parametrize("site", [None, "cross-site", "same-site", "none"])
def test_a_post_must_come_from_the_page(begun, site):
    page = begun()
    headers = {} if site is None else {"sec-fetch-site": site}
    assert page.client.post("/api/back", json={}, headers=headers).status_code == 403


def test_a_post_of_the_page_is_taken(begun):
    page = begun()
    for headers in ({"origin": OWN}, {"sec-fetch-site": "same-origin"}):
        reply = page.client.post("/api/state", json={}, headers=headers)
        assert reply.status_code == 400
        assert "No model is fitted" in reply.json()["message"]


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_pages_cannot_include_ours(begun, site):
    page = begun()
    for path in ("/static/start.js", "/api/opening", "/api/script.py"):
        assert page.client.get(path, headers={"sec-fetch-site": site}).status_code == 403


@pytest.mark.parametrize("path", ["/", "/static/start.js", "/api/opening", "/nothing"])
def test_every_reply_has_the_headers(begun, path):
    page = begun()
    refused = page.client.get(path, headers={"host": "evil.example"})
    for reply in (page.client.get(path), refused):
        for name, value in HEADERS.items():
            assert reply.headers[name] == value


def test_a_page_has_no_script_or_style_of_its_own(begun):
    html = begun().client.get("/").text
    assert html.count("<script") == html.count("<script src=")
    assert "<style" not in html
    assert " style=" not in html
    assert " onclick" not in html


def test_websockets_are_refused(begun):
    from starlette.websockets import WebSocketDisconnect

    page = begun()
    with (
        pytest.raises(WebSocketDisconnect),
        page.client.websocket_connect("/api/events"),
    ):
        pass


def test_keys_are_new_each_time():
    one, other = Keys(), Keys()
    assert len({one.token, one.cookie, other.token, other.cookie}) == 4
    assert len(one.token) > 40
