"""Import of AutoDRIVE logs: verdicts, what is left out and said, and folders that are none."""

from __future__ import annotations

import gzip
import json
import random
import shutil
import tarfile
from pathlib import Path
from typing import Any

import pytest
from unit.conductor.report.autodrive_logs import MODELS, config, drive, text, write_logs

from conductor.records.fingerprint import fingerprint
from conductor.report import make_report, report_json, write_result_page
from conductor.report.analysis.losses import kind_of
from conductor.report.autodrive import importing as autodrive_import
from conductor.report.autodrive.importing import import_autodrive
from conductor.report.autodrive.kpi import judge, kpi_columns
from conductor.report.autodrive.layout import IMPORT_FILE, Instance
from conductor.report.autodrive.logs import read_log
from conductor.report.reading.dossier import open_dossier
from schemas.files.autodrive_log import COLUMNS
from twin.base.errors import InfrastructureError, UsageError
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi

PUBLISHED = Path(__file__).parents[6] / "shared" / "data" / "autodrive_opencav_aeb"
FIRST = "batch_1/aeb_metrics_sim_inst_1.csv"


def edit(path: Path, change: Any) -> None:
    lines = path.read_text().split("\n")
    change(lines)
    path.write_text("\n".join(lines))


def test_logs_become_a_campaign_with_one_report(tmp_path: Path) -> None:
    def rows(instance):
        if instance["weather_id"] == 4 and instance["model"] == "yolov3-tiny":
            return drive(instance, brake_m=2.0, stop_m=0.0)
        if instance["time_of_day"] == 300:
            return drive(instance, brake_m=70.0, stop_m=65.0)
        return drive(instance)

    write_logs(tmp_path / "logs", rows=rows)
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert found.files == 8
    assert not found.left_out
    tables = report_json(tmp_path / "run")
    lines = {line["model"]: line for line in tables["systems"]}
    assert (lines["yolov2"]["passed"], lines["yolov3-tiny"]["passed"]) == (2, 1)
    assert (lines["yolov2"]["no_collision"], lines["yolov3-tiny"]["no_collision"]) == (4, 2)
    assert lines["yolov2"]["counts"] == {"pass": 2, "false_braking": 2, "collision": 0}
    assert (lines["yolov2"]["batches"], lines["yolov3-tiny"]["batches"]) == ([1], [2])
    (hidden,) = [each for each in tables["findings"] if each["kind"] == "hidden"]
    said = (
        "Of 6 cases without a collision, 3 did not pass: 3 false braking (yolov2 2, yolov3-tiny 1)."
    )
    assert hidden["text"] == said
    assert tables["alarms"] == []
    cases = {case["case"]: case for case in tables["cases"]}
    hit = cases["yolov3-tiny-0500-heavy_fog"]
    assert (hit["verdict"], hit["passed"], hit["collisions"]) == ("collision", False, 1)
    assert (hit["aeb_time_s"], hit["aeb_dtc_m"]) == (146.0, 2.0)
    # What the logs do not hold is missing, not 0.
    assert hit["impact_speed_mps"] is hit["speed_max_mps"] is hit["decel_peak_mps2"] is None
    page = make_report(tmp_path / "run", plots=False).page.read_text()
    assert found.sha256 in page
    assert "nothing was simulated here" in page
    assert said in page
    assert "<code>batch_2/aeb_metrics_sim_inst_3.csv</code>" in page
    assert "campaign.yaml --out" not in page  # there is nothing to run
    text = write_result_page(tmp_path / "run", tmp_path / "page.md").read_text()
    again = (
        "conductor report --import-autodrive logs --out again-run\nconductor fingerprint again-run"
    )
    assert again in text
    assert f"{again}\nconductor fingerprint run" in page
    assert "in the folder that holds both" in page
    repeated = import_autodrive(tmp_path / "logs", tmp_path / "again")
    assert repeated == found
    assert fingerprint(tmp_path / "again") == fingerprint(tmp_path / "run")


def test_columns_go_by_their_names(tmp_path: Path) -> None:
    data = write_logs(tmp_path / "logs")
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    turned = tuple(reversed(COLUMNS))
    instance = data["simulation_instances"][0]
    # Byte order mark, line ends and spaces of whoever saved it with a spreadsheet.
    mixed = "\ufeff" + text(drive(instance), turned).replace(",", ", ").replace("\n", "\r\n")
    (tmp_path / "logs" / FIRST).write_bytes(mixed.encode())
    assert not import_autodrive(tmp_path / "logs", tmp_path / "turned").left_out
    assert fingerprint(tmp_path / "turned") == fingerprint(tmp_path / "run")


def test_rows_that_cannot_be_read_are_listed_and_the_others_count(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")

    def damage(lines):
        lines[4] = lines[4].rpartition(",")[0]  # torn
        lines[5] = lines[5].replace("2024-03-18", "yesterday")
        lines[6] = lines[3]  # time goes back
        lines[7] = lines[7].replace("148.00", "x").replace("142.00", "nan").replace("142", "x")
        lines[8] = lines[8].rpartition(",")[0] + ","  # no number of collisions
        lines[9] = '"' + lines[9]  # a quote that never ends
        lines[11] = ""

    edit(tmp_path / "logs" / FIRST, damage)
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    notes = "\n".join(found.left_out)
    for expected in (
        "line 5 left out: torn (19 of 20 values)",
        "line 6 left out: no Timestamp",
        "line 7 left out: Timestamp not after the row before",
        "line 8 left out: DTC (m) is no number",
        "line 9 left out: no number of Collisions (#)",
        "line 10 left out: torn (0 of 20 values)",
    ):
        assert f"{FIRST}: {expected}" in notes
    assert len(found.left_out) == 6
    rows = read_kpi(tmp_path / "run/cases/yolov2-0500-clear/attempt-1/kpi.parquet").num_rows
    assert rows == 131 - 7
    assert report_json(tmp_path / "run")["passed"] == 8


def test_gaps_stay_missing_in_their_row(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")

    def gaps(lines):
        cells = lines[1].split(",")
        for column in ("DTC (m)", "Brake (%)", "AEB (bool)", "PosX (m)"):
            cells[COLUMNS.index(column)] = ""
        lines[1] = ",".join(cells)
        for at in range(20, 40):
            cells = lines[at].split(",")
            cells[COLUMNS.index("Throttle (%)")] = " "
            lines[at] = ",".join(cells)

    edit(tmp_path / "logs" / FIRST, gaps)
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert sorted(found.left_out) == [
        f"{FIRST}: 20 lines from line 21 on without Throttle (%)",
        f"{FIRST}: line 2 without DTC (m), Brake (%), PosX (m), AEB (bool)",
    ]
    row = read_kpi(tmp_path / "run/cases/yolov2-0500-clear/attempt-1/kpi.parquet").to_pylist()[0]
    assert row["dtc_m"] != row["dtc_m"]
    assert row["brake"] is row["aeb"] is None
    case = report_json(tmp_path / "run")["cases"][0]
    assert (case["dtc_min_m"], case["passed"]) == (20.0, True)


@pytest.mark.parametrize(("cut", "lost"), [(1, 0), (3, 1), (30, 1)])
def test_a_cut_off_last_line(tmp_path: Path, cut: int, lost: int) -> None:
    """A whole last row counts: what it says of a collision may be all there is."""
    write_logs(tmp_path / "logs", rows=lambda i: drive(i, brake_m=2.0, stop_m=0.0)[:-2])
    path = tmp_path / "logs" / FIRST
    path.write_text(path.read_text()[:-cut])
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert len(found.left_out) == lost
    assert all("left out: cut off" in note for note in found.left_out)
    case = report_json(tmp_path / "run")["cases"][0]
    assert case["status"] == ("unresolved" if lost else "collision")


def test_missing_and_foreign_logs_never_pass(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")
    folder = tmp_path / "logs" / "batch_1"
    (folder / "aeb_metrics_sim_inst_1.csv").unlink()
    (folder / "aeb_metrics_sim_inst_2.csv").write_text("")
    other = tmp_path / "logs" / "batch_2" / "aeb_metrics_sim_inst_3.csv"
    (folder / "aeb_metrics_sim_inst_3.csv").write_bytes(other.read_bytes())
    edit(folder / "aeb_metrics_sim_inst_4.csv", lambda lines: lines.__setitem__(0, lines[1]))
    (folder / "aeb_metrics_sim_inst_9.csv").write_text("x")
    (folder / "notes.txt").write_text("x")
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    tables = report_json(tmp_path / "run")
    assert tables["passed"] == 4
    reasons = [case["reasons"][0] for case in tables["cases"][:4]]
    assert {case["outcome"] for case in tables["cases"][:4]} == {"unresolved"}
    assert reasons[0].endswith("inst_1.csv: no such file")
    assert "no column Timestamp" in reasons[1]
    assert "of another case: Model 'yolov3-tiny', not 'yolov2'" in reasons[2]
    assert "no column Timestamp, DTC (m), Collisions (#)" in reasons[3]
    assert "batch_1/aeb_metrics_sim_inst_9.csv: the configuration has no case for it" in (
        found.left_out
    )
    assert "batch_1/notes.txt: not the name of a log" in found.left_out
    assert all(reason in found.left_out for reason in reasons)


@pytest.mark.parametrize("date", ["0001-01-01", "9999-12-31"])
def test_a_log_of_which_little_can_be_read_never_passes(tmp_path: Path, date: str) -> None:
    """A first time that is damaged leaves no row after it; the obstacle is further than ever."""
    write_logs(tmp_path / "logs")
    damaged = tmp_path / "logs" / FIRST
    edit(damaged, lambda lines: lines.__setitem__(1, lines[1].replace("2024-03-18", date)))
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    case = report_json(tmp_path / "run")["cases"][0]
    assert (case["outcome"], case["passed"]) == ("unresolved", None)
    assert case["reasons"] == [f"{FIRST}: 130 of 131 rows cannot be read"]
    assert any("130 lines from line 3 on left out: Timestamp" in note for note in found.left_out)


def test_batches_that_are_not_there_are_named_and_left_out(tmp_path: Path) -> None:
    data = write_logs(tmp_path / "logs", config(("a", "b", "c")))
    for file in (tmp_path / "logs" / "batch_2").iterdir():
        file.unlink()
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert found.absent_batches == [2]
    tables = report_json(tmp_path / "run")
    assert [line["model"] for line in tables["systems"]] == ["a", "c", "All"]
    assert [line["batches"] for line in tables["systems"]] == [[1], [3], [1, 3]]
    assert len(data["simulation_instances"]) == 12


def test_archives_are_read_as_they_were_published(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs")
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    packed = tmp_path / "packed"
    packed.mkdir()
    (packed / "config.json").write_bytes((tmp_path / "logs" / "config.json").read_bytes())
    for batch in ("batch_1", "batch_2"):
        with tarfile.open(packed / f"{batch}.tar.gz", "w:gz") as archive:
            archive.add(tmp_path / "logs" / batch, batch)
    assert not import_autodrive(packed, tmp_path / "unpacked").left_out
    assert fingerprint(tmp_path / "unpacked") == fingerprint(tmp_path / "run")
    half = (packed / "batch_2.tar.gz").read_bytes()
    (packed / "batch_2.tar.gz").write_bytes(half[: len(half) // 2])
    (packed / "batch_3.tar.gz").write_bytes(gzip.compress(b"no archive"))
    found = import_autodrive(packed, tmp_path / "damaged")
    assert any("batch_2.tar.gz: not read to its end" in note for note in found.left_out)
    assert any("batch_3.tar.gz: not read to its end" in note for note in found.left_out)


def packed_batches(folder: Path) -> bytes:
    """Logs as archives alone; the bytes of the second one, unpacked."""
    write_logs(folder)
    for batch in ("batch_1", "batch_2"):
        with tarfile.open(folder / f"{batch}.tar.gz", "w:gz") as archive:
            archive.add(folder / batch, batch)
        shutil.rmtree(folder / batch)
    return gzip.decompress((folder / "batch_2.tar.gz").read_bytes())


def test_a_damaged_archive_is_always_said(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    whole = packed_batches(logs)
    path = logs / "batch_2.tar.gz"
    stored = gzip.compress(whole, 0)
    header = stored.index(b"batch_2/aeb_metrics_sim_inst_3.csv")
    value = stored.index(b"-208.24", header)
    tail = bytearray(gzip.compress(whole))
    tail[len(tail) // 2] ^= 0xFF  # the stream itself
    for data in (
        stored[:header] + b"X" * 8 + stored[header + 8 :],
        gzip.compress(whole.replace(b"batch_2/aeb_metrics_sim_inst_3", b"batch_2/aeb_xxxxxxx", 1)),
        stored[:value] + b"-208.25" + stored[value + 7 :],
        bytes(tail),
        gzip.compress(whole)[:-4],
    ):
        path.write_bytes(data)
        found = import_autodrive(logs, tmp_path / "run")
        assert any("batch_2.tar.gz: not read to its end" in note for note in found.left_out), data[
            :20
        ]
    path.write_bytes(gzip.compress(whole.rstrip(b"\0") + b"\0" * 4096))
    assert not import_autodrive(logs, tmp_path / "run").left_out


def without(*columns: str) -> Any:
    """Drives with empty cells, that hit in fog."""

    def rows(instance):
        hits = instance["weather_id"] == 4
        made = drive(instance, stop_m=0.0, brake_m=2.0) if hits else drive(instance, brake_m=70.0)
        return [{**row, **dict.fromkeys(columns, "")} for row in made]

    return rows


def test_an_aeb_that_was_not_logged_is_no_missing_trigger(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", rows=without("AEB (bool)"))
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert len(found.without_aeb) == 8
    tables = report_json(tmp_path / "run")
    said = {each["kind"]: each["text"] for each in tables["findings"]}
    assert said["collision"] == (
        "Of 4 collisions, 0 came without any AEB trigger and 0 in spite of one; in 4 AEB was not "
        "logged."
    )
    assert said["hidden"] == "Of 4 cases without a collision, 0 did not pass."
    assert "early" not in said
    hit = next(row for row in open_dossier(tmp_path / "run").rows if row.status == "collision")
    assert kind_of(hit) == "collision, AEB not logged"


def test_without_distances_there_is_nothing_but_a_collision_to_tell(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", rows=without("DTC (m)", "PosX (m)", "PosY (m)"))
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    cases = report_json(tmp_path / "run")["cases"]
    assert [case["verdict"] for case in cases] == [None, None, "collision", "collision"] * 2
    assert cases[0]["reasons"] == [f"{FIRST}: DTC (m) in 0 of 131 rows"]


def test_a_gap_in_the_first_row_is_no_rest(tmp_path: Path) -> None:
    rows = drive(config()["simulation_instances"][0], stop_m=25.0)
    for column in ("DTC (m)", "PosX (m)"):
        rows[0][column] = rows[-1][column] = ""
    instance = Instance(**config()["simulation_instances"][0])
    log = read_log("log", text(rows).encode(), instance)
    assert not log.foreign
    end = judge(log.rows, kpi_table(kpi_columns(log.rows)), 30.0, 120.0)
    assert (end.verdict, end.reason) == ("pass", "came to rest 25.00 m from the obstacle")


def test_hostile_names_are_names_here_and_said(tmp_path: Path) -> None:
    names = ("<img src=x onerror=alert(1)>", "../../etc", "=cmd|' /C calc'!A0\x1b[2J")
    data = config(names)
    write_logs(tmp_path / "logs", data)
    found = import_autodrive(tmp_path / "logs", tmp_path / "run")
    tables = report_json(tmp_path / "run")
    assert [line["model"] for line in tables["systems"][:-1]] == [
        "img-src-x-onerror-alert-1",
        "etc",
        "cmd-c-calc-a0-2j",
    ]
    assert "model '../../etc' is called 'etc' here" in found.left_out
    assert all(note.isprintable() for note in found.left_out)
    assert "<img" not in make_report(tmp_path / "run", plots=False).page.read_text()


def test_cases_that_occur_twice_are_repeats(tmp_path: Path) -> None:
    data = config(MODELS[:1])
    data["simulation_instances"][1] = data["simulation_instances"][0]
    write_logs(tmp_path / "logs", data)
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    ids = [case["case"] for case in report_json(tmp_path / "run")["cases"]]
    assert ids[:2] == ["yolov2-0500-clear", "yolov2-0500-clear-repeat_1"]


def nothing(folder: Path) -> None:
    """As it is."""


def remove_config(folder: Path) -> None:
    (folder / "config.json").unlink()


def bad_weather(folder: Path) -> None:
    data = json.loads((folder / "config.json").read_text())
    data["simulation_instances"][3]["weather_id"] = 9
    (folder / "config.json").write_text(json.dumps(data))


def no_json(folder: Path) -> None:
    (folder / "config.json").write_text("{")


def no_logs(folder: Path) -> None:
    for file in folder.glob("batch_*/*"):
        file.unlink()


def taken(folder: Path) -> None:
    (folder.parent / "run").mkdir()
    (folder.parent / "run" / "campaign.yaml").write_text("campaign: mine\n")


def a_file(folder: Path) -> None:
    (folder.parent / "run").write_text("mine")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (remove_config, "config.json: No such file"),
        (bad_weather, r"simulation_instances\[3\].weather_id"),
        (no_json, "no configuration of the AutoDRIVE study"),
        (no_logs, "no log batch_N"),
        (taken, "holds campaign.yaml and no import"),
        (a_file, "not a folder"),
    ],
)
def test_what_cannot_be_imported_is_one_line(tmp_path: Path, spoil: Any, said: str) -> None:
    write_logs(tmp_path / "logs")
    spoil(tmp_path / "logs")
    kept = sorted(tmp_path.rglob("*"))
    with pytest.raises(UsageError, match=said) as caught:
        import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == kept
    with pytest.raises(UsageError):
        import_autodrive(tmp_path / "logs", tmp_path / "logs")


def test_an_import_is_made_anew_and_a_damaged_one_is_told(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", config(("a", "b")))
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    write_logs(tmp_path / "logs", config(("c", "d")))
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert not list((tmp_path / "run" / "cases").glob("a-*"))
    assert report_json(tmp_path / "run")["passed"] == 8
    (tmp_path / "run" / IMPORT_FILE).write_text("{}")
    with pytest.raises(InfrastructureError, match=IMPORT_FILE):
        report_json(tmp_path / "run")


@pytest.mark.slow
@pytest.mark.skipif(
    not PUBLISHED.is_dir(), reason=f"the published logs are not beside the project: {PUBLISHED}"
)
def test_the_published_logs_give_table_1_and_what_it_hides(tmp_path: Path) -> None:
    found = import_autodrive(PUBLISHED, tmp_path / "run")
    assert (found.files, found.rows, found.left_out) == (128, 64154, [])
    assert found.absent_batches == [3, 4, 5, 6]
    tables = report_json(tmp_path / "run")
    lines = {line["model"]: (line["no_collision"], line["total"]) for line in tables["systems"]}
    assert lines == {"yolov2": (64, 64), "yolov3-tiny": (55, 64), "All": (119, 128)}
    passed = {line["model"]: line["passed"] for line in tables["systems"]}
    assert passed == {"yolov2": 49, "yolov3-tiny": 52, "All": 101}
    texts = {each["kind"]: each["text"] for each in tables["findings"]}
    assert texts["hidden"] == (
        "Of 119 cases without a collision, 18 did not pass: 15 false braking (yolov2 14, "
        "yolov3-tiny 1), 3 unresolved (yolov2 1, yolov3-tiny 2)."
    )
    assert texts["early"] == (
        "Of 101 passes, 6 first triggered AEB further than 60 m from the obstacle, 2 times the "
        "limit of false braking, and drove on (yolov2 1, yolov3-tiny 5)."
    )


def damaged(draw: random.Random, data: bytes) -> bytes:
    """A log with bytes changed, lost, repeated and put in."""
    odd = [b'"', b",", b"\n", b"\r", b"\0", b"'", b"\xff\xfe", b"1e999", b"nan", b"-", b"1" * 400]
    odd += [b"9999-12-31 23:59:59", b"0001-01-01", "\u00b2".encode()]
    for _ in range(draw.randint(1, 8)):
        at, length = draw.randrange(len(data)), draw.randint(1, 200)
        more = draw.choice([draw.choice(odd), data[at : at + length], b""])
        end = at + draw.choice([0, 1, length])
        data = data[:at] + more + data[end:]
    return data


def test_no_damage_breaks_the_reading_and_every_row_is_read_or_listed() -> None:
    instance = config()["simulation_instances"][0]
    whole = text(drive(instance)[:40]).encode()
    outcomes = {"read": 0, "foreign": 0, "whole": 0}
    for seed in range(400):
        data = damaged(random.Random(seed), whole)
        log = read_log("log", data, Instance(**instance))
        lines = data.decode("utf-8-sig", errors="replace").split("\n")[1:]
        if log.foreign:
            outcomes["foreign"] += 1
            continue
        outcomes["read" if log.notes else "whole"] += 1
        table = kpi_table(kpi_columns(log.rows))
        assert kpi_sha256(table)
        end = judge(log.rows, table, 30.0, 0.0)
        decided = ("pass", "false_braking", "collision", "time_up")
        assert (end.verdict in decided) == (end.outcome == "verdict"), seed
        if len(log.rows) < sum(bool(line.strip()) for line in lines):
            assert any("left out" in note for note in log.notes), seed
    assert min(outcomes.values()) > 10, outcomes


def test_a_row_that_is_left_out_does_not_begin_the_log() -> None:
    instance = config()["simulation_instances"][0]
    rows = drive(instance)
    rows[0]["Collisions (#)"] = "x"
    rows[0]["Timestamp"] = "2020-01-01 00:00:00"
    log = read_log("log", text(rows).encode(), Instance(**instance))
    assert not log.foreign
    assert log.rows[0].time_us == 0


def test_a_number_that_nothing_can_have_is_left_out() -> None:
    instance = config()["simulation_instances"][0]
    rows = drive(instance)
    rows[3]["DTC (m)"] = "1e200"
    log = read_log("log", text(rows).encode(), Instance(**instance))
    assert log.notes == ["log: line 5 left out: DTC (m) is beyond 1e+09"]


def test_an_import_that_was_killed_can_be_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_logs(tmp_path / "logs")

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(autodrive_import, "_write_campaign", killed)
        with pytest.raises(KeyboardInterrupt):
            import_autodrive(tmp_path / "logs", tmp_path / "run")
    with pytest.raises(UsageError, match=r"no outcomes\.json"):
        report_json(tmp_path / "run")
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    assert report_json(tmp_path / "run")["passed"] == 8
    assert not (tmp_path / "run" / ".importing").exists()
