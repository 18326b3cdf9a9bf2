"""The server of `idic draw` answers its own page only: token, host, origin; no path from outside, a report in a
sandbox."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from starlette.testclient import TestClient

sys.path.insert(0, str(Path(__file__).parents[1] / "draw"))

from drawn_folder import make_folder, plan  # noqa: E402

from idic.draw.desk import Desk  # noqa: E402
from idic.draw.watch import state_of  # noqa: E402
from idic.draw.server import MAX_BODY_BYTES, application  # noqa: E402
from idic.draw import HOST, new_token, open_socket  # noqa: E402
from idic.errors import InputError  # noqa: E402

PORT, TOKEN = 45671, "right-token"
OUTSIDE_TEXT = "what lies outside"
OWN = f"http://{HOST}:{PORT}"


@pytest.fixture
def folder(tmp_path):
    return make_folder(tmp_path / "test")


@pytest.fixture
def client(folder):
    return TestClient(application(Desk(folder), TOKEN, PORT), base_url=OWN)


def test_the_page_and_its_answers_need_the_token(client):
    assert client.get(f"/{TOKEN}/").status_code == 200 and client.get(f"/{TOKEN}/api/files").status_code == 200
    for path in ("/", "/wrong/", f"/{TOKEN}x/", "/wrong/api/files", "/wrong/draw.css", "/api/files", f"//{TOKEN}/"):
        assert client.get(path).status_code == 404, path


@pytest.mark.parametrize("headers", [
    {"host": "evil.example"}, {"host": f"evil.example:{PORT}"}, {"host": f"{HOST}:1"},
    {"origin": "http://evil.example"}, {"origin": "null"},
    {"origin": f"https://{HOST}:{PORT}"}, {"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"}])
def test_another_host_or_origin_is_refused(client, folder, headers):
    assert client.get(f"/{TOKEN}/api/files", headers=headers).status_code == 404
    answer = client.post(f"/{TOKEN}/api/write", json={"plan": plan(), "replace": True},
                         headers={"origin": OWN} | headers)
    assert answer.status_code == 404 and not (folder / "experiment.toml").exists()


def test_a_change_needs_the_origin_of_the_page_and_json(client, folder):
    body = {"plan": plan(), "replace": False}
    assert client.post(f"/{TOKEN}/api/write", json=body).status_code == 404  # no origin
    assert client.get(f"/{TOKEN}/api/write").status_code == 405
    form = client.post(f"/{TOKEN}/api/write", content=json.dumps(body),
                       headers={"origin": OWN, "content-type": "text/plain"})
    assert form.status_code == 422 and not (folder / "experiment.toml").exists()
    assert client.post(f"/{TOKEN}/api/write", json=body, headers={"origin": OWN}).status_code == 200
    assert (folder / "experiment.toml").exists()


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"null", b'{"plan": 1}', b'{"replace": true}', b"[" * 5000,
                                  b'{"plan": {"images": ["a"]}}', b'{"plan": NaN, "replace": true}',
                                  b'{"plan": "\\ud800", "replace": true}', b'{"plan": 1e999, "replace": true}'])
def test_strange_bodies_get_one_message(client, body):
    answer = client.post(f"/{TOKEN}/api/write", content=body,
                         headers={"origin": OWN, "content-type": "application/json"})
    assert answer.status_code == 422 and answer.json()["what"]


def test_a_body_without_end_is_refused(client):
    body = b'"' + b"x" * MAX_BODY_BYTES + b'"'
    answer = client.post(f"/{TOKEN}/api/mesh", content=body,
                         headers={"origin": OWN, "content-type": "application/json"})
    assert answer.status_code == 422 and "too large" in answer.json()["what"]


@pytest.mark.parametrize("path", [
    "..%2f..%2fserver.py", "%2e%2e/server.py", "server.py", "../desk.py", "%2fetc%2fpasswd", "api", "report/..%2f..",
    "report/%2e%2e",
    "api/log?name=../secret.csv&images=images/*.tif", "api/log?name=/etc/passwd&images=images/*.tif",
    "api/area?images=../*.tif",
    "api/part?images=/etc/*&x0=0&y0=0&x1=9&y1=9&width=9", "api/run?name=../.."])
def test_no_path_leaves_the_folder(client, tmp_path, path):
    (tmp_path / "secret.csv").write_text("a_mm\n1\n")
    answer = client.get(f"/{TOKEN}/{path}")
    assert answer.status_code in (404, 422) and "root:" not in answer.text


@pytest.mark.parametrize("query", ["x0=nan&y0=0&x1=9&y1=9&width=9", "x0=0&y0=0&x1=inf&y1=9&width=9",
                                   "x0=0&y0=0&x1=9&y1=9&width=x", "x0=0",
                                   "x0=0&y0=0&x1=9&y1=9&width=9&frame=99", "x0=0&y0=0&x1=9&y1=9&width=9&frame=-1"])
def test_strange_parts_of_an_image_are_refused(client, query):
    assert client.get(f"/{TOKEN}/api/part?images=images/*.tif&{query}").status_code in (404, 422)


def test_a_report_comes_in_a_sandbox_and_not_through_a_link(client, folder, tmp_path):
    run = folder / "runs" / "run-1"
    run.mkdir(parents=True)
    (run / "report.html").write_text("<script>fetch('../api/files')</script>")
    answer = client.get(f"/{TOKEN}/report/run-1")
    policy = answer.headers["content-security-policy"]
    assert answer.status_code == 200 and "sandbox" in policy and "allow-same-origin" not in policy
    assert "connect-src" not in policy
    (run / "report.html").unlink()
    (tmp_path / "secret.html").write_text("secret")
    (run / "report.html").symlink_to(tmp_path / "secret.html")
    assert client.get(f"/{TOKEN}/report/run-1").status_code == 404


def test_every_answer_forbids_frames_sniffing_and_other_origins(client):
    for path in ("", "app.js", "api/files", "api/log"):
        headers = client.get(f"/{TOKEN}/{path}").headers
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer" and "access-control-allow-origin" not in headers


def test_the_page_asks_for_nothing_elsewhere_and_holds_no_inline_code(client):
    page = client.get(f"/{TOKEN}/").text
    assert "://" not in page and "<script>" not in page and "onclick" not in page and "style=" not in page


def test_the_server_listens_on_this_machine_only_with_a_new_token_each_time():
    place = open_socket(0)
    try:
        assert place.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InputError, match="port"):
            open_socket(place.getsockname()[1])
    finally:
        place.close()
    assert len({new_token() for _ in range(20)}) == 20 and len(new_token()) >= 32


@pytest.mark.parametrize("make", [lambda path, target: path.symlink_to(target), lambda path, _: os.mkfifo(path)])
@pytest.mark.parametrize("place", ["runs/run-1.console.txt", "runs/run-1/log.txt", "runs/run-1/result.json"])
def test_the_page_reads_and_writes_no_link_and_no_pipe(tmp_path, make, place):
    folder = make_folder(tmp_path / "test")
    secret = tmp_path / "secret.txt"
    secret.write_text(OUTSIDE_TEXT)
    (folder / "runs" / "run-1").mkdir(parents=True)
    make(folder / place, secret)
    shown = state_of(folder, "run-1")
    assert OUTSIDE_TEXT not in str(shown)
    if place.endswith("console.txt"):
        desk = Desk(folder)
        (folder / "experiment.toml").write_text("")
        with pytest.raises(InputError, match=r"a symbolic link|a pipe"):
            desk.identify("run-1")
    assert secret.read_text() == OUTSIDE_TEXT


def test_a_run_of_the_page_is_no_link(tmp_path):
    folder = make_folder(tmp_path / "test")
    (folder / "runs").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (folder / "runs" / "run-1").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="a symbolic link"):
        state_of(folder, "run-1")
