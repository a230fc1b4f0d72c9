"""What the conductor and the simulators say becomes tables, pictures and events."""

import json
from types import SimpleNamespace

import msgspec
import pytest
from unit.viewer.console.console_runs import CASES, a_run, ended, outcomes
from view_messages import thumbnail

from schemas.wire.codec import encode
from schemas.wire.view import ClockReading
from twin.base.errors import UnreachableError
from twin.fabric.bus import Sample
from viewer.console import overview, remote_run
from viewer.console.remote_run import ASK_AGAIN_S, MissedEndings
from viewer.console.run_folder import find_runs
from viewer.console.site import ConsoleSite
from viewer.console.stream import EventStream
from viewer.console.watch import CLOCKS_S, PICTURE_BYTES_MAX, SILENCE_S, LiveWatch
from viewer.live.link import Cases, ConductorEvent, LinkEnded, ReadClocks, Said, Status


class Heard:
    """A watch that nobody speaks to but the test, and a page that follows it."""

    def __init__(self, folder=None, follows=True, files=None):
        self.site = ConsoleSite(find_runs(folder) if folder else [], keep=False)
        self.stream = EventStream("e")
        here = folder is not None
        self.watch = LiveWatch(self.site, self._nowhere, self.stream, here=here, files=files)
        self.stream.followers = int(follows)
        self.now_s = 0.0
        self.asked = []
        """Campaigns whose cases the conductor was asked for."""
        self.watch.link.ask_cases = self.asked.append
        self._told = 0

    def _nowhere(self):
        raise UnreachableError("nobody is there")

    def status(self, out="", running=(), first=False, **row):
        campaign = {"out": str(out), "cases": 4, "left": 4, "leased": len(running), "paused": False}
        leases = [{"campaign": "demo", "case": case, "worker": "w1"} for case in running]
        found = {"campaigns": {"demo": campaign | row}, "workers": [], "running": leases}
        self.watch.take(Status(found, first), self.now_s)

    def cases(self, *rows):
        self.watch.take(Cases({"campaign": "demo", "next": None, "cases": [*rows]}), self.now_s)

    def fact(self, **fact):
        self.watch.take(ConductorEvent(fact), self.now_s)

    def committed(self, case, **result):
        result = {"campaign": "demo", "case": case, **ended(**result)}
        self.fact(fact="committed", result=result, worker="w1", attempt=1)

    def picture(self, case, jpeg=b"jpeg", **changes):
        sample = msgspec.structs.replace(thumbnail(case=case), **changes)
        key = f"view/{sample.campaign}/{sample.case}/thumbnail"
        self.watch.slots.put(Sample(key, jpeg, encode(sample)))

    def events(self, kind):
        """Events of a kind since the last question, after a turn half a minute later."""
        self.now_s += 30.0
        self.watch.status_s = self.now_s
        self.watch.turn(self.now_s)
        texts = [event.text.splitlines() for event in self.stream.wait(self._told, 0)]
        self._told += len(texts)
        return [json.loads(t[2][6:]) for t in texts if t[1] == f"event: {kind}".encode()]

    def read(self, path):
        return json.loads(self.site.answer(path).data)


def test_a_campaign_without_a_folder_is_known_from_what_is_heard():
    heard = Heard()
    heard.status(running=["c1"])
    (event,) = heard.events("table")
    assert event["reset"], "a page may have asked before anybody told it what changes"
    heard.picture("c2", weather="clear", model="m")
    (event,) = heard.events("table")
    assert event["reset"], "it has an axis that was not there"
    heard.committed("c1", verdict="collision")
    assert heard.events("table")[0]["reset"], "and columns"
    heard.status(running=["c2", "c3"])
    (event,) = heard.events("table")
    assert event["cases"] == ["c3"]
    assert event["rows"]["1"] == {"state": "running"}
    table = heard.read("runs/demo/table.json")
    assert table["cases"] == ["c1", "c2", "c3"]
    assert table["columns"]["verdict"] == ["collision", None, None]
    assert table["version"] == event["version"]
    (row,) = heard.read("runs.json")["runs"]
    assert (row["state"], row["cases"], row["done"]) == ("running", 4, 1)
    assert row["running"] == 2
    heard.status(running=["c1", "c2"])  # the lease of a case that has just ended
    (row,) = heard.read("runs.json")["runs"]
    assert row["running"] == 1
    heard.watch.turn(heard.now_s + 2 * SILENCE_S)
    (row,) = heard.read("runs.json")["runs"]
    assert row["running"] is None, "nobody knows"


def test_a_folder_that_is_at_hand_is_the_campaigns(tmp_path):
    run = a_run(tmp_path / "demo", recorded=())
    outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    heard = Heard(run)
    heard.status(out=run, running=CASES[:1])
    heard.events("table")
    heard.committed(CASES[0], verdict="collision")
    assert len(heard.events("table")) == 1
    assert heard.read("runs/demo/table.json")["columns"]["verdict"][0] == "collision"
    # What the file says of the end counts, and what it does not say yet was heard.
    rows = {CASES[0]: ended("pass"), **{case: {"outcome": ""} for case in CASES[1:]}}
    outcomes(run, rows, complete=False)
    heard.committed(CASES[1], verdict="collision")
    columns = heard.read("runs/demo/table.json")["columns"]
    assert columns["verdict"][:2] == ["pass", "collision"]
    assert list(heard.site.runs) == ["demo"]


def test_what_is_not_at_hand_is_said_with_where_it_is(tmp_path):
    silent = Heard()
    silent.status(running=["c1"])
    assert silent.read("runs/demo/run.json")["away"] == {"folder": None, "command": None}
    heard = Heard()
    heard.status(out="/far/my runs/demo\x1b[2J", running=["c1"])
    heard.committed("c1", verdict="collision", scalars={"impact_speed_mps": 3.0})
    away = {
        "folder": r"/far/my runs/demo\x1b[2J",
        "command": r"viewer web --run '/far/my runs/demo\x1b[2J'",
    }
    assert heard.read("runs/demo/run.json")["away"] == away
    page = heard.read("runs/demo/cases/c1/case.json")
    assert page["away"] == away
    assert page["repeat"].startswith(r"conductor run '/far/my runs/demo\x1b[2J/campaign.yaml' ")
    assert [(kpi["name"], kpi["value"]) for kpi in page["kpis"]] == [("impact_speed_mps", 3.0)]
    assert (page["film"], page["log"], page["events"]) == (None, None, [])
    run = a_run(tmp_path / "demo", recorded=())
    beside = Heard(run)
    beside.status(out=run)
    assert beside.read("runs/demo/run.json")["away"] is None


def test_a_folder_is_not_believed_over_the_network(tmp_path):
    run = a_run(tmp_path / "demo", recorded=())
    heard = Heard()
    heard.status(out=run)
    assert heard.read("runs/demo/table.json")["cases"] == []


def test_pictures_are_told_with_their_age():
    heard = Heard()
    heard.status(running=["c1", "c2"])
    heard.events("picture")
    heard.picture("c2", b"first", sim_time_ns=1_500_000_000)
    (event,) = heard.events("picture")
    assert event == {"run": "demo", "pictures": [[1, 1, 1.5, 0.0]]} | {
        "from": "console",
        "within_s": None,
    }
    assert heard.site.answer("runs/demo/cases/c2/moment.webp").data == b"first"
    assert heard.site.answer("runs/demo/cases/c2/moment.webp").media_type == "image/jpeg"
    assert heard.events("picture") == []
    assert heard.read("runs/demo/pictures/atlas.json")["has"] == [False, True]


def test_age_counts_from_the_simulator_where_its_clock_is_known():
    heard = Heard()
    heard.status(running=["c1", "c2"])
    asked = []
    heard.watch.link.read_clocks = lambda: asked.append(heard.now_s)
    heard.picture("c1", rig="r1", at_s=500.0)
    (event,) = heard.events("picture")
    assert (event["from"], event["within_s"], len(asked)) == ("console", None, 1)
    # The clock of the rig is 470 s ahead of ours, known within 0.1 s.
    answer = [ClockReading(v=1, rig="r1", clock_s=500.0)]
    heard.watch.take(ReadClocks(answer, 29.9, 30.1), 30.1)
    heard.picture("c1", rig="r1", at_s=529.0, sim_time_ns=2_000_000_000)
    (event,) = heard.events("picture")
    assert event["pictures"] == [[0, 2, 2.0, 1.0]]
    assert (event["from"], event["within_s"]) == ("simulator", pytest.approx(0.1, abs=0.01))
    heard.picture("c1", rig="r1", at_s=559.0)
    heard.picture("c2")
    (event,) = heard.events("picture")
    assert event["from"] == "console", "of one it is not known"
    assert [round(row[3]) for row in event["pictures"]] == [1, 0]


def test_pictures_that_lag_are_said_once_and_their_end_too():
    heard = Heard()
    heard.status(running=["c1"])
    heard.watch.take(ReadClocks([ClockReading(v=1, rig="r1", clock_s=0.0)], 0.0, 0.0), 0.0)
    heard.events("log")
    told = []
    for lag_s in (0.3, 2.4, 7.0, 1.5, 0.4):
        heard.picture("c1", rig="r1", at_s=heard.now_s + 30.0 - lag_s)
        told.append([(event["level"], event["text"]) for event in heard.events("log")])
    assert told == [
        [],
        [("warn", "pictures lag 2.4 s behind the simulators")],
        [],
        [],
        [("info", "pictures are up to date with the simulators")],
    ]


def test_a_campaign_that_keeps_up_does_not_take_back_what_is_said_of_one_that_lags():
    heard = Heard()
    row = {"out": "", "cases": 4, "left": 4, "leased": 1, "paused": False}
    leases = [
        {"campaign": name, "case": "c1", "worker": "w1"} for name in ("lagging", "demo", "also")
    ]
    campaigns = dict.fromkeys((lease["campaign"] for lease in leases), row)
    heard.watch.take(Status({"campaigns": campaigns, "workers": [], "running": leases}), 0.0)
    heard.watch.take(ReadClocks([ClockReading(v=1, rig="r1", clock_s=0.0)], 0.0, 0.0), 0.0)
    heard.events("log")
    told = []
    for lagging_s in (5.0, 5.0, 0.2):
        for name, lag_s in (("demo", 0.1), ("lagging", lagging_s), ("also", 0.1)):
            heard.picture("c1", campaign=name, rig="r1", at_s=heard.now_s + 30.0 - lag_s)
        told.append([event["level"] for event in heard.events("log")])
    assert told == [["warn"], [], ["info"]]


def test_clocks_are_read_now_and_then_and_only_while_somebody_looks():
    heard = Heard()
    asked = []
    heard.watch.link.read_clocks = lambda: asked.append(heard.now_s)
    heard.status(running=["c1"])
    for _ in range(3):
        heard.events("picture")
    assert asked == [30.0, 60.0, 90.0]
    heard.watch.turn(heard.now_s + CLOCKS_S - 0.1)
    assert len(asked) == 3
    heard.stream.followers = 0
    heard.events("picture")
    assert len(asked) == 3


def test_an_attempt_that_is_over_shows_nothing_more():
    heard = Heard()
    heard.status(running=["c1"])
    heard.picture("c1", b"second", token=9)
    heard.events("picture")
    heard.picture("c1", b"first", token=8)
    assert heard.events("picture") == []
    assert heard.site.answer("runs/demo/cases/c1/moment.webp").data == b"second"


@pytest.mark.parametrize("change", ["campaign", "size", "bytes"])
def test_what_no_campaign_sent_is_counted_or_left(change):
    heard = Heard()
    heard.status()
    if change == "campaign":
        heard.picture("c1", campaign="other")
    elif change == "size":
        heard.picture("c1", bytes(PICTURE_BYTES_MAX + 1))
    else:
        heard.watch.slots.put(Sample("view/demo/c1/thumbnail", b"jpeg", b"\xff"))
    assert heard.events("picture") == []
    assert heard.watch.strangers == (change != "campaign")
    assert heard.read("runs/demo/table.json")["cases"] == []


def test_facts_of_another_version_are_no_end_of_the_console():
    heard = Heard()
    heard.status(running=["c1"])
    heard.fact(fact="committed", result={"campaign": "demo", "case": "c1", "outcome": 1})
    heard.fact(
        fact="committed",
        result={"campaign": "demo", "verdict": "x", "reasons": [], "case": "c1", "scalars": 3},
        worker="w",
        attempt=1,
    )
    assert heard.watch.strangers == 2
    assert heard.read("runs/demo/table.json")["columns"]["verdict"] == [None]


def test_charged_cases_are_quarantined_until_they_end():
    heard = Heard()
    heard.status(running=["c1"])
    attempt = {"campaign": "demo", "case": "c1", "token": 1, "reason": "rig_died"}
    heard.fact(fact="attempt_ended", charged=False, detail="", **attempt)
    assert heard.watch.charged["demo"] == {}
    heard.fact(fact="attempt_ended", charged=True, detail="the rig \x1b[2Jdied", **attempt)
    assert heard.watch.charged["demo"] == {"c1": "the rig \\x1b[2Jdied"}
    heard.committed("c1")
    assert heard.watch.charged["demo"] == {}


def test_nothing_is_made_while_nobody_looks():
    heard = Heard(follows=False)
    heard.status(running=["c1"])
    heard.picture("c1")
    assert heard.events("table") == []
    assert heard.events("picture") == []
    assert heard.site.answer("runs/demo/cases/c1/moment.webp").data == b"jpeg"


def test_a_silent_conductor_leaves_no_case_running():
    heard = Heard()
    heard.status(running=["c1"])
    assert heard.read("runs/demo/table.json")["columns"]["state"] == ["running"]
    heard.watch.turn(heard.now_s + SILENCE_S + 1)
    assert heard.read("runs/demo/table.json")["columns"]["state"] == ["waiting"]
    heard.watch.take(Said("connected to tcp/127.0.0.1:1"), 0.0)
    heard.status(running=["c1"])
    assert heard.read("runs/demo/table.json")["columns"]["state"] == ["running"]


def test_lines_of_the_log_are_escaped():
    heard = Heard()
    heard.status()
    heard.fact(
        fact="case_ended", campaign="demo", case="c1", outcome="unresolved", reason="\x1b<b>"
    )
    (event,) = heard.events("log")
    assert (event["level"], event["text"]) == ("error", "demo/c1 unresolved: \\x1b<b>")


def test_waiting_that_does_not_help_ends_it():
    heard = Heard()
    with pytest.raises(UnreachableError):
        heard.watch.take(LinkEnded(UnreachableError("no")), 0.0)


def test_the_end_of_one_attempt_ends_no_case():
    heard = Heard()
    heard.status(running=["c1"])
    heard.picture("c1", outcome="intervened", verdict="")
    heard.events("picture")
    columns = heard.read("runs/demo/table.json")["columns"]
    assert (columns["state"], columns["verdict"]) == (["running"], [None])
    heard.fact(fact="case_ended", campaign="demo", case="c1", outcome="cancelled", reason="r")
    assert heard.read("runs/demo/table.json")["columns"]["verdict"] == ["cancelled"]


def test_a_lease_takes_no_charges_from_a_case(tmp_path):
    run = a_run(tmp_path / "demo", recorded=())
    rows = {case: {"outcome": "", "attempts": 2, "charges": ["rig_died"]} for case in CASES}
    outcomes(run, rows, complete=False)
    heard = Heard(run)
    heard.status(out=run, running=CASES[:1])
    ending = heard.site.runs["demo"].ending(CASES[0])
    assert (ending.attempts, ending.charges) == (2, ["rig_died"])


def test_one_run_that_cannot_be_read_does_not_silence_the_others(tmp_path, monkeypatch):
    run = a_run(tmp_path / "demo", recorded=())
    outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    heard = Heard(run)
    heard.status(out=run, running=CASES[:1])
    heard.events("table")
    heard.picture(CASES[0])
    (run / "outcomes.json").write_text("{")
    assert heard.events("table") == heard.events("picture") == []
    monkeypatch.setattr(heard.site.runs["demo"], "table", _let_down)
    assert heard.events("table") == []
    heard.fact(fact="committed", result={"campaign": "demo", "case": CASES[0]} | ended())
    heard.fact(fact="committed", campaign="demo", result="none")
    assert heard.watch.strangers == 2
    monkeypatch.undo()
    outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    heard.picture(CASES[0])
    assert len(heard.events("picture")) == 1


def _let_down():
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("here", [True, False])
def test_nothing_of_a_campaign_stays_when_it_is_begun_anew(tmp_path, here):
    old, new = (a_run(tmp_path / name / "demo", recorded=()) for name in ("old", "new"))
    for run in (old, new):
        outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    heard = Heard(old if here else None)
    heard.status(out=old, running=CASES[:1])
    heard.picture(CASES[0])
    heard.committed(CASES[0], verdict="collision")
    heard.events("picture")
    shown = heard.watch.shown("demo")
    heard.status(out=new, running=CASES[1:2])
    assert (shown.live_pictures, shown.live is None) == ({}, here)
    assert heard.read("runs/demo/table.json")["columns"]["verdict"] == [None] * (4 if here else 1)
    anew = heard.watch.shown("demo")
    assert (anew.run.folder == new, anew.run.id) == (here, "demo-2" if here else "demo")
    assert anew.running == {CASES[1]}
    assert heard.events("table")[-1] == {
        "run": anew.run.id,
        "version": heard.read(f"runs/{anew.run.id}/table.json")["version"],
        "reset": True,
    }


def test_a_session_that_was_cut_asks_for_the_cases_as_they_stand():
    heard = Heard()
    heard.status(running=["c1", "c2"], first=True)
    assert heard.asked == ["demo"], "the campaign may have begun long ago"
    heard.committed("c1")
    heard.fact(fact="case_ended", campaign="demo", case="c2", outcome="cancelled", reason="r")
    heard.status(left=2)
    assert heard.asked == ["demo"]
    heard.status(left=2, first=True)
    assert heard.asked == ["demo", "demo"]
    heard.committed("c4")  # after the conductor had answered, and heard before the answer
    heard.cases({"case": "c4", "outcome": ""})
    # Meanwhile one was taken back, one has ended, and a third nobody has heard of.
    heard.cases(
        {"case": "c0", "outcome": "verdict", "verdict": "collision", "scalars": {"dtc_min_m": 0}},
        {"case": "c1", "outcome": "verdict", "verdict": "pass", "attempts": 1},
        {"case": "c2", "outcome": "", "attempts": 1, "charges": ["died \x1b (worker w1)"]},
        {"case": "c3", "outcome": ""},
    )
    table = heard.read("runs/demo/table.json")
    verdicts = dict(zip(table["cases"], table["columns"]["verdict"], strict=True))
    assert verdicts == {"c1": "pass", "c2": None, "c4": "pass", "c0": "collision", "c3": None}
    assert heard.watch.charged["demo"] == {"c2": "died \\x1b (worker w1)"}
    heard.cases({"case": "c2", "outcome": "unresolved", "charges": ["died (worker w1)"]})
    assert heard.watch.charged["demo"] == {}
    version = heard.read("runs/demo/table.json")["version"]
    heard.cases({"case": "c3", "outcome": ""}, {"outcome": "verdict"})
    assert heard.read("runs/demo/table.json")["version"] == version, "it says nothing new"


def test_cases_of_a_folder_at_hand_are_asked_for_after_a_cut_alone(tmp_path):
    run = a_run(tmp_path / "demo", recorded=())
    outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    heard = Heard(run)
    heard.status(out=run, first=True)
    heard.committed(CASES[0])
    heard.status(out=run, left=0)
    assert heard.asked == []
    heard.status(out=run, first=True)
    assert heard.asked == ["demo"]
    heard.cases({"case": CASES[0], "outcome": ""})  # it was taken back
    assert heard.read("runs/demo/table.json")["columns"]["verdict"][0] is None


def test_a_fact_that_got_lost_is_noticed_by_the_counts():
    missed = MissedEndings()
    assert missed.status(5, 0, 0.0, anew=True)
    assert not missed.status(5, 5, 1.0, anew=False)
    assert not missed.status(6, 5, 2.0, anew=False), "its fact may be on its way"
    assert not missed.status(7, 5, 3.0, anew=False), "asked a moment ago"
    now_s = ASK_AGAIN_S
    assert not missed.status(8, 7, now_s, anew=False), "one is on its way again"
    assert missed.status(8, 7, now_s + 1, anew=False)
    assert not missed.status(8, 8, now_s + 2, anew=False)
    assert not missed.status(8, 9, now_s + 20, anew=False), "a fact that is ahead of the status"
    assert not missed.status(9, 10, now_s + 30, anew=False), "and another one"
    assert missed.status(9, 10, now_s + 31, anew=False), "one was taken back, which nobody heard"


@pytest.mark.parametrize(("most", "asked"), [(5, 2), (4, 1)])
def test_a_campaign_of_more_cases_than_are_shown_is_not_asked_for_again_and_again(
    monkeypatch, most, asked
):
    monkeypatch.setattr(remote_run, "CASES_MAX", most)
    heard = Heard()
    heard.status(cases=9, left=2, first=True)
    heard.cases(*({"case": f"c{n}", "outcome": "verdict", "verdict": "pass"} for n in range(4)))
    heard.now_s = ASK_AGAIN_S
    for _ in range(2):  # seven have ended, as it says
        heard.status(cases=9, left=2)
    assert len(heard.asked) == asked


def test_a_campaign_that_begins_anew_is_asked_for_again():
    heard = Heard()
    heard.status(attempts=9)
    heard.status(attempts=9)
    assert heard.asked == ["demo"]
    heard.status(attempts=1)
    assert heard.asked == ["demo", "demo"]


def test_the_time_of_a_running_campaign_goes_on_while_nothing_is_leased(tmp_path, monkeypatch):
    run = a_run(tmp_path / "demo", recorded=())
    outcomes(run, {case: {"outcome": ""} for case in CASES}, complete=False)
    (run / "timeline.jsonl").write_text('{"at_s":100.0,"event":"leased","worker":"w1"}\n')
    monkeypatch.setattr(overview, "time", SimpleNamespace(time=lambda: 190.0))
    heard = Heard(run)
    heard.status(out=run, running=CASES[:1])
    assert heard.read("runs.json")["runs"][0]["elapsed_s"] == 90.0
    heard.watch.turn(heard.now_s + SILENCE_S + 1)
    assert heard.read("runs.json")["runs"][0]["elapsed_s"] == 0.0, "nobody says that it runs"
