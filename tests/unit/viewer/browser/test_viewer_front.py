"""The front's answers, asked over a real socket: what it gives, to whom, and what it refuses."""

import gzip
import http.client
import json
import socket
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from unit.viewer.recorded_case import write
from waiting import PATIENCE_S

from twin.base.errors import UsageError
from viewer.browser.assets import Asset
from viewer.browser.front import (
    POLICY,
    READS,
    REPORT_POLICY,
    BrowserFront,
    ShownSite,
    SingleRecording,
)
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite

WASM = Asset(b"\0asm" + bytes(1000), "application/wasm", "7.7")


@contextmanager
def front(folder=None, hub=None, **site):
    """A running front, over the campaigns of ``folder``; yields a function that asks it."""
    if "single" not in site:
        site["console"] = ConsoleSite(find_runs(folder) if folder else [], keep=False)
    if hub is not None:
        site["hub"] = lambda: hub
    with BrowserFront(0, ShownSite({"re_viewer_bg.wasm": WASM}, **site)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.server_address[1]

        def ask(path, method="GET", body=None, **headers):
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
            names = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, body, names)
            answer = connection.getresponse()
            data = answer.read()
            connection.close()
            return answer, data

        yield ask
        server.shutdown()


@pytest.fixture
def folder(tmp_path):
    for case in ("a b", "c"):
        write(tmp_path / "cases" / case / "attempt-1", case=case)
    (tmp_path / "secret.rrd").write_bytes(b"secret")
    return tmp_path


def test_pages_and_what_they_ask_for(folder):
    with front(folder=folder) as ask:
        for path, words in [
            ("/view?case=c", b"canvas"),
            ("/case.js", b"re_viewer_bg.wasm"),
            ("/style.css", b"canvas"),
        ]:
            answer, data = ask(path)
            assert answer.status == 200
            assert words in data
            assert answer.headers["Content-Security-Policy"] == POLICY
        (run,) = json.loads(ask("/data/runs.json")[1])["runs"]
        name = run["id"]
        assert json.loads(ask(f"/data/runs/{name}/table.json")[1])["cases"] == ["a b", "c"]
        about = json.loads(ask(f"/about.json?run={name}&case=a%20b")[1])
        assert about["name"] == name
        assert [row["case"] for row in about["cases"]] == ["a b"]
        assert not any("path" in row for row in about["cases"]), "no folder names in a browser"
        answer, data = ask(f"/recording/{name}/a%20b.rrd")
        assert data == (folder / "cases" / "a b" / "attempt-1" / "recording.rrd").read_bytes()


def test_pages_name_no_other_host():
    with front() as ask:
        for name in ("/view", "/case.js", "/panel.js", "/style.css"):
            answer, data = ask(name)
            assert answer.status == 200
            assert b"//" not in data.replace(b"rerun+http://${", b"").replace(b"// ", b"")
    assert "http" not in POLICY
    assert "*" not in POLICY


def test_large_files_are_packed_and_kept_by_browsers():
    with front() as ask:
        answer, data = ask("/re_viewer_bg.wasm", Accept_Encoding="gzip, br")
        assert answer.headers["Content-Encoding"] == "gzip"
        assert gzip.decompress(data) == WASM.data
        assert ask("/re_viewer_bg.wasm")[1] == WASM.data
        answer, data = ask("/re_viewer_bg.wasm", If_None_Match=answer.headers["ETag"])
        assert (answer.status, data) == (304, b"")


@pytest.mark.parametrize(
    "path",
    [
        *("/recording/no.rrd", "/recording/..%2f..%2fsecret.rrd", "/../secret.rrd", "/secret.rrd"),
        *("/recording/RUN/..%2f..%2fsecret.rrd", "/recording/../secret.rrd", "/x", "/data/x"),
        *("/data/runs/../runs.json", "/data/runs/RUN/cases/..%2f..%2fsecret/moment.webp"),
        *("/data/runs/RUN/cases/%00/case.json", "/data/runs/RUN/pictures/160x90/-1.webp"),
        *("/data/runs/RUN/pictures/9x9/0.webp", "/data/runs/RUN/cases/c/film/99.webp"),
        *("/data/runs/nobody/run.json", "/data/runs/RUN/search.json", "/report/RUN/report.html"),
        *("/report/..%2f..%2fetc/report.html", "/data/compare/RUN/nobody.json"),
        "/data/runs/RUN/cases/c/film/%F0%9F%98%80.webp",
    ],
)
def test_what_is_not_there_is_not_found(folder, path):
    with front(folder=folder) as ask:
        answer, data = ask(path.replace("RUN", folder.name))
        assert answer.status == 404
        assert b"secret" not in data.replace(b"secret.rrd", b"").replace(b"secret'", b"")


def test_an_error_is_a_line_for_the_page(folder, tmp_path):
    with front(folder=folder) as ask:
        for path in (f"/recording/{folder.name}/cc.rrd", "/about.json?case=cc"):
            assert b"did you mean 'c'?" in ask(path)[1]
        assert b"choose a case in the console" in ask("/about.json")[1]
        assert b"no case 'cc'" in ask(f"/data/runs/{folder.name}/cases/cc/case.json")[1]
        assert b"no campaign 'cc' here" in ask("/data/runs/cc/run.json")[1]
    with pytest.raises(UsageError, match="not a campaign folder"):
        find_runs(tmp_path / "cases")
    with front(hub=("127.0.0.1", 1)) as ask:
        assert ask("/recording/c.rrd")[0].status == 404
        assert json.loads(ask("/about.json")[1])["live"] is True


def test_a_report_has_an_origin_of_its_own(folder):
    (folder / "report.html").write_text("<script>alert(1)</script>")
    with front(folder=folder) as ask:
        answer, data = ask(f"/report/{folder.name}/report.html")
        assert data == b"<script>alert(1)</script>"
        assert answer.headers["Content-Security-Policy"] == REPORT_POLICY
        assert REPORT_POLICY.startswith("sandbox allow-scripts; default-src 'none'")
        assert ask("/data/runs.json")[0].headers["Content-Security-Policy"] == POLICY
    (folder / "report.html").unlink()
    (folder / "report.html").symlink_to("/etc/passwd")
    with front(folder=folder) as ask:
        assert ask(f"/report/{folder.name}/report.html")[0].status == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "localhost:9300"}, 200),
        ({"Host": "[::1]:9300"}, 200),
        ({"Host": "localhost:9300", "Origin": "http://localhost:9300"}, 200),
        ({"Host": "evil.example"}, 403),
        ({"Host": "evil.example:80"}, 403),
        ({"Host": "localhost:9300", "Origin": "http://evil.example"}, 403),
        ({"Host": "localhost:9300", "Origin": "null"}, 403),
    ],
)
def test_only_our_own_pages_may_ask(folder, headers, status):
    with front(folder=folder) as ask:
        assert ask("/data/runs.json", **headers)[0].status == status


class Hub(BaseHTTPRequestHandler):
    """Sends a stream in pieces, and the next one only when the first has arrived."""

    protocol_version = "HTTP/1.1"
    arrived = threading.Event()

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.send_header("Content-Type", "application/grpc-web+proto")
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()
        for piece in (b"first " + body, b" second"):
            self.wfile.write(b"%x\r\n%s\r\n" % (len(piece), piece))
            self.wfile.flush()
            assert self.arrived.wait(PATIENCE_S)
        self.wfile.write(b"0\r\n\r\n")

    def log_message(self, *_):
        pass


def test_the_live_stream_is_passed_on_as_it_comes_and_nothing_else_is():
    with ThreadingHTTPServer(("127.0.0.1", 0), Hub) as hub:
        threading.Thread(target=hub.serve_forever, daemon=True).start()
        with BrowserFront(0, ShownSite({}, hub=lambda: hub.server_address)) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            connection = http.client.HTTPConnection(*server.server_address, timeout=PATIENCE_S)
            connection.request("POST", READS, b"hello", {"Content-Type": "application/grpc-web"})
            answer = connection.getresponse()
            assert answer.headers["Content-Type"] == "application/grpc-web+proto"
            assert answer.read1(100) == b"first hello"
            Hub.arrived.set()
            assert answer.read() == b" second"
            connection.close()
            for path in (READS.replace("Read", "Write"), "/rerun.x/Y", "/"):
                connection = http.client.HTTPConnection(*server.server_address, timeout=PATIENCE_S)
                connection.request("POST", path, b"hello")
                assert connection.getresponse().status == 404
                connection.close()
            server.shutdown()
        hub.shutdown()


def test_a_hub_that_is_gone_and_requests_that_are_too_large(folder):
    with front(hub=("127.0.0.1", 1)) as ask:
        assert ask(READS, "POST", b"x")[0].status == 502
        assert ask(READS, "POST", bytes(1 << 17))[0].status == 413
    with front(folder=folder) as ask:
        assert ask(READS, "POST", b"x")[0].status == 404


@pytest.mark.parametrize(
    "request_line",
    ["GET http://[::1 HTTP/1.1", f"POST {READS} HTTP/1.1\r\nContent-Length: \xb2"],
)
def test_nonsense_is_a_bad_request(request_line):
    with BrowserFront(0, ShownSite({}, hub=lambda: ("127.0.0.1", 1))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with socket.create_connection(server.server_address, timeout=PATIENCE_S) as line:
            line.sendall(f"{request_line}\r\nHost: localhost\r\n\r\n".encode("latin-1"))
            assert line.recv(100).startswith(b"HTTP/1.1 400 ")
        server.shutdown()


class SilentHub(BaseHTTPRequestHandler):
    """Begins its answer, and has nothing more to say until its reader is gone."""

    left = threading.Event()

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        self.end_headers()
        if not self.rfile.read(1):
            self.left.set()

    def log_message(self, *_):
        pass


def test_a_browser_that_goes_away_while_nothing_comes_is_noticed():
    with ThreadingHTTPServer(("127.0.0.1", 0), SilentHub) as hub:
        threading.Thread(target=hub.serve_forever, daemon=True).start()
        with BrowserFront(0, ShownSite({}, hub=lambda: hub.server_address)) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            connection = http.client.HTTPConnection(*server.server_address, timeout=PATIENCE_S)
            connection.request("POST", READS, b"hello")
            answer = connection.getresponse()
            assert not SilentHub.left.is_set()
            answer.close()
            connection.close()
            assert SilentHub.left.wait(PATIENCE_S)
            server.shutdown()
        hub.shutdown()


def test_a_port_in_use_is_one_line():
    with (
        BrowserFront(0, ShownSite({})) as server,
        pytest.raises(UsageError, match="choose another, or 0 for a free one"),
    ):
        BrowserFront(server.server_address[1], ShownSite({}))


def test_a_single_recording_is_served_and_nothing_beside_it(tmp_path):
    path = tmp_path / "a b.rrd"
    path.write_bytes(b"recorded")
    (tmp_path / "other.rrd").write_bytes(b"other")
    with front(single=SingleRecording(path, "a b", 1.5)) as ask:
        assert b"canvas" in ask("/")[1]
        about = json.loads(ask("/about.json")[1])
        row = {"case": "a b", "verdict": "", "complete": True, "moment_s": 1.5}
        assert about == {
            "live": False,
            "single": True,
            "name": "a b",
            "cases": [row],
            "missing": [],
        }
        answer, data = ask("/recording/a%20b.rrd")
        assert (answer.status, data) == (200, b"recorded")
        for name in ("other", "..%2Fa%20b", ""):
            assert ask(f"/recording/{name}.rrd")[0].status == 404
