"""The console over a real socket: events that resume, who may do what, and who gets nothing."""

import http.client
import json
import threading
import time
from contextlib import contextmanager

import pytest
from unit.viewer.console.console_runs import CASES, a_run
from waiting import PATIENCE_S

from twin.base.errors import UnreachableError, UsageError
from viewer.browser.assets import Asset
from viewer.browser.front import BrowserFront, ShownSite
from viewer.console.live_console import LiveConsole
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
from viewer.console.stream import FOLLOWERS_MAX
from viewer.console.watch import SILENCE_S
from viewer.live.link import Status

TOKEN = "known"


class Operator:
    """In the place of a conductor: remembers what it was asked."""

    def __init__(self, operates=True):
        self.token, self.asked, self._operates = TOKEN, [], operates

    def knows(self, token):
        return token == TOKEN

    def operates(self):
        if self._operates is None:
            raise UnreachableError("nobody is there")
        return self._operates

    def control(self, request):
        if not self._operates:
            raise UsageError("a key of role viewer may not ask conductor/rpc/admin")
        self.asked.append((request.action, request.campaign, request.case, request.worker))
        return 2

    def explain(self, campaign, case):
        return [f"waits: {campaign}/{case} \x1b[1m"]

    def do(self, body):
        self.asked.append(json.loads(body))
        return b"{}"


def nowhere():
    raise UnreachableError("nobody is there")


class Served:
    """A console of running cases behind a port."""

    def __init__(self, server, live, operator):
        self.live, self.operator = live, operator
        self.port = server.server_address[1]
        self.host = f"127.0.0.1:{self.port}"

    def ask(self, path, method="GET", body=None, **headers):
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        line.request(method, path, body, names)
        answer = line.getresponse()
        data = answer.read()
        line.close()
        return answer, data

    def act(self, name, body, **changes):
        headers = {
            "Origin": f"http://{self.host}",
            "Content_Type": "application/json",
            "X_Steer_Token": TOKEN,
        } | changes
        headers = {key: value for key, value in headers.items() if value is not None}
        answer, data = self.ask(f"/act/{name}", "POST", json.dumps(body), **headers)
        return answer.status, json.loads(data) if data[:1] == b"{" else data

    @contextmanager
    def events(self, path="/data/events", **headers):
        """Yields a function that gives the next event: its id, kind and data."""
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        line.request("GET", path, headers={k.replace("_", "-"): v for k, v in headers.items()})
        answer = line.getresponse()
        assert answer.headers["Content-Type"].startswith("text/event-stream")

        def take():
            fields = {}
            while text := answer.readline().rstrip(b"\n"):
                name, _, value = text.partition(b": ")
                fields[name.decode()] = value.decode()
            return fields.get("id"), fields["event"], json.loads(fields["data"])

        try:
            yield take
        finally:
            answer.close()
            line.close()


@contextmanager
def served(folder, operates=True):
    site, operator = ConsoleSite(find_runs(folder), keep=False), Operator(operates)
    live = LiveConsole(site, nowhere, operator, here=True)
    status = {
        "campaigns": {"demo": {"out": str(folder), "cases": 4, "left": 3, "leased": 1}},
        "workers": [{"id": "w1", "present": True}],
        "running": [{"campaign": "demo", "case": CASES[0], "worker": "w1"}],
    }
    live.watch.take(Status(status), 0.0)
    assets = {"re_viewer.js": Asset(b"", "text/javascript", "1")}
    shown = ShownSite(assets, site, hub=lambda: None, live=live, desk=operator)
    with BrowserFront(0, shown) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield Served(server, live, operator)
        finally:
            live.stream.close()
            server.shutdown()


@pytest.fixture
def run(tmp_path):
    return a_run(tmp_path / "demo", recorded=())


def test_a_page_that_comes_back_is_sent_what_it_missed(run):
    with served(run) as console:
        with console.events() as take:
            first, kind, hello = take()
            assert (kind, hello["resync"], list(hello["version"])) == ("hello", False, ["demo"])
            console.live.stream.put("log", {"n": 1})
            seen, kind, data = take()
            assert (kind, data) == ("log", {"n": 1})
            assert seen != first
        console.live.stream.put("log", {"n": 2})
        console.live.stream.put("log", {"n": 3})
        for how in ({"Last_Event_ID": seen}, {"path": f"/data/events?since={seen}"}):
            with console.events(**how) as take:
                assert take()[2]["resync"] is False
                assert [take()[2]["n"], take()[2]["n"]] == [2, 3]


@pytest.mark.parametrize("last", ["another-7", "x", "-", "\u00e9"])
def test_a_page_of_another_server_asks_for_all_anew(run, last):
    with served(run) as console, console.events(Last_Event_ID=last) as take:
        assert take()[2]["resync"] is True


def test_a_page_that_hears_nothing_hears_that_the_line_stands(run, monkeypatch):
    monkeypatch.setattr("viewer.browser.front.HEARTBEAT_S", 0.01)
    with served(run) as console, console.events() as take:
        take()
        number, kind, data = take()
        assert (number, kind, data) == (None, "beat", {})


def test_so_many_pages_follow_and_no_more(run):
    with served(run) as console:
        console.live.stream.followers = FOLLOWERS_MAX
        answer, _ = console.ask("/data/events")
        assert answer.status == 503
        console.live.stream.followers = 0


def test_a_role_is_told_to_who_knows_the_token(run):
    for operates, token, role in [
        (True, TOKEN, "operate"),
        (True, "guessed", "look"),
        (True, "", "look"),
        (False, TOKEN, "look"),
        (None, TOKEN, "look"),
    ]:
        with served(run, operates) as console:
            found = json.loads(console.ask("/data/runs.json", X_Steer_Token=token)[1])
            assert (found["roles"], found["live"]) == (role, True)


def test_nothing_is_done_before_it_is_confirmed(run):
    with served(run) as console:
        status, answer = console.act("cancel", {"run": "demo"})
        assert status == 200
        assert "3 cases that have not ended end as cancelled" in answer["confirm"]
        assert "never a pass" in answer["confirm"]
        assert console.operator.asked == []
        status, answer = console.act("cancel", {"run": "demo", "confirm": True})
        assert (status, answer) == (200, {"done": "cancel demo: 2 cases"})
        assert console.operator.asked == [("cancel", "demo", "", "")]


@pytest.mark.parametrize(
    ("act", "body", "words", "asked"),
    [
        ("pause", {"run": "demo"}, "No verdict changes", ("pause", "demo", "", "")),
        ("resume", {"run": "demo", "case": "c"}, "case c of demo", ("resume", "demo", "c", "")),
        ("drain", {"worker": "w1"}, "No verdict changes", ("drain", "", "", "w1")),
        (
            "intervene",
            {"run": "demo", "campaign": "demo", "case": "c", "token": 7, "settings": {"hour": 7.0}},
            "of case c of demo ends as intervened: it gets no verdict",
            {"campaign": "demo", "case": "c", "token": 7, "settings": {"hour": 7.0}},
        ),
        (
            "intervene",
            {
                "run": "demo",
                "campaign": "demo",
                "case": "c",
                "token": 7,
                "action": {"action": "pause"},
            },
            "its verdict stays",
            {
                "campaign": "demo",
                "case": "c",
                "token": 7,
                "settings": {},
                "action": {"action": "pause"},
            },
        ),
    ],
)
def test_each_act_says_what_it_costs_and_is_passed_on(run, act, body, words, asked):
    with served(run) as console:
        assert words in console.act(act, body)[1]["confirm"]
        status, answer = console.act(act, body | {"confirm": True})
        assert status == 200
        assert answer["done"]
        assert console.operator.asked == [asked]


@pytest.mark.parametrize(
    ("act", "body", "words"),
    [
        ("retry", {"run": "demo"}, "given 'retry', allowed: pause, resume"),
        ("", {}, "given ''"),
        ("cancel", {"run": "nobody"}, "'nobody' is no campaign"),
        ("drain", {"confirm": True}, "say which worker"),
        ("pause", {"run": "demo", "confirm": "yes"}, "confirm"),
        ("pause", {"run": "demo", "sudo": True}, "sudo"),
        ("pause", [], "object"),
        (
            "intervene",
            {"run": "demo", "campaign": "demo", "case": "c", "confirm": True},
            "give settings",
        ),
        ("intervene", {"campaign": "demo", "case": "c"}, "'' is no campaign"),
        (
            "intervene",
            {"run": "demo", "campaign": "other", "case": "c", "confirm": True},
            "'demo' is demo, the attempt is of 'other'",
        ),
    ],
)
def test_what_is_no_act_is_one_line(run, act, body, words):
    with served(run) as console:
        status, answer = console.act(act, body)
        assert status == 409
        assert words in answer["error"]
        assert "\n" not in answer["error"]
        assert console.operator.asked == []


def test_a_viewers_key_is_refused_by_its_role(run):
    with served(run, operates=False) as console:
        status, answer = console.act("cancel", {"run": "demo", "confirm": True})
        assert (status, console.operator.asked) == (409, [])
        assert "role viewer" in answer["error"]


@pytest.mark.parametrize(
    "change",
    [
        {"X_Steer_Token": "guessed"},
        {"X_Steer_Token": None},
        {"Origin": None},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Content_Type": "text/plain"},
        {"Content_Type": None},
        {"Host": "evil.example"},
    ],
)
def test_another_site_or_user_does_nothing(run, change):
    with served(run) as console:
        status, _ = console.act("cancel", {"run": "demo", "confirm": True}, **change)
        assert status == 403
        assert console.operator.asked == []


def test_another_site_follows_no_events_and_embeds_no_picture(run):
    with served(run) as console:
        for path in ("/data/events", "/data/runs.json", "/data/runs/demo/workers.json"):
            assert console.ask(path, Origin="http://evil.example")[0].status == 403
            assert console.ask(path, Host="evil.example")[0].status == 403
        answer, _ = console.ask("/data/runs.json")
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert "Access-Control-Allow-Origin" not in answer.headers


def test_workers_leases_and_the_reasons_of_quarantine(run):
    with served(run) as console:
        console.live.watch.charged["demo"] = {CASES[1]: "its rig died"}
        console.live.watch.status_s = time.monotonic()
        found = json.loads(console.ask("/data/runs/demo/workers.json")[1])
        assert [worker["id"] for worker in found["workers"]] == ["w1"]
        assert [lease["case"] for lease in found["leases"]] == [CASES[0]]
        (row,) = found["quarantine"]
        assert row["case"] == CASES[1]
        assert row["explain"] == [f"waits: demo/{CASES[1]} \\x1b[1m"]
        assert console.ask("/data/runs/nobody/workers.json")[0].status == 404


def test_an_answer_that_has_not_changed_is_not_sent_again(run):
    with served(run) as console:
        first, data = console.ask("/data/runs/demo/table.json")
        again, nothing = console.ask(
            "/data/runs/demo/table.json", If_None_Match=first.headers["ETag"]
        )
        assert (again.status, nothing) == (304, b"")
        packed, small = console.ask("/data/runs/demo/table.json", Accept_Encoding="gzip")
        assert packed.headers["Content-Encoding"] == "gzip"
        assert len(small) < len(data)


def test_a_finished_console_has_no_events_and_no_acts(run):
    with BrowserFront(0, ShownSite({}, ConsoleSite(find_runs(run), keep=False))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        console = Served(server, None, None)
        assert console.ask("/data/events")[0].status == 404
        workers = json.loads(console.ask("/data/runs/demo/workers.json")[1])
        assert workers["workers"] == workers["leases"] == []
        assert console.act("cancel", {"run": "demo"})[0] == 404
        server.shutdown()


def test_what_is_missing_may_come_while_the_conductor_has_said_nothing(run):
    with served(run) as console:
        console.live.watch.status_s = None
        assert console.ask("/data/runs/other/table.json")[0].status == 503
        console.live.watch.error = UnreachableError("nobody is there")
        assert console.ask("/data/runs/other/table.json")[0].status == 404


def test_a_silent_conductor_is_asked_for_no_explanation(run):
    with served(run) as console:
        console.live.watch.charged["demo"] = {CASES[0]: "rig_died"}
        console.live.watch.status_s = time.monotonic()
        (row,) = console.live.workers("demo")["quarantine"]
        assert row["explain"]
        console.live.watch.status_s = time.monotonic() - SILENCE_S - 1
        (row,) = console.live.workers("demo")["quarantine"]
        assert (row["charge"], row["explain"]) == ("rig_died", [])


def test_a_damaged_run_is_listed_and_its_workers_are_told(run):
    with served(run) as console:
        console.live.watch.charged["demo"] = {CASES[0]: "rig_died"}
        (run / "outcomes.json").write_bytes(bytes(100))
        (row,) = json.loads(console.ask("/data/runs.json")[1])["runs"]
        assert row["state"] == "damaged"
        assert "outcomes.json: damaged" in row["error"]
        answer, data = console.ask("/data/runs/demo/table.json")
        assert (answer.status, data.decode()) == (404, row["error"])
        found = json.loads(console.ask("/data/runs/demo/workers.json")[1])
        assert [lease["case"] for lease in found["leases"]] == [CASES[0]]
        assert [row["case"] for row in found["quarantine"]] == [CASES[0]]
