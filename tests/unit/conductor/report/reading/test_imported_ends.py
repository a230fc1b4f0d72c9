"""How imported logs end: what decides a case, what does not, and what is told of it first."""

from __future__ import annotations

import io
import json
import shutil
import tarfile
from pathlib import Path
from typing import Any

import pytest
from unit.conductor.report.autodrive_logs import MODELS, Rows, config, drive, text, write_logs

from conductor.report import make_report, report_json
from conductor.report.autodrive.importing import import_autodrive
from conductor.report.pages.content import first_screen
from conductor.report.reading.dossier import Dossier, open_dossier

PUBLISHED = Path(__file__).parents[6] / "shared" / "data" / "autodrive_opencav_aeb"
published = pytest.mark.skipif(
    not PUBLISHED.is_dir(), reason=f"the published logs are not beside the project: {PUBLISHED}"
)
FIRST = "batch_1/aeb_metrics_sim_inst_1.csv"
CASE = "yolov2-0500-clear"


def imported(folder: Path, rows: Any = drive, **changes: Any) -> Dossier:
    """The campaign of made-up logs; ``rows`` makes those of a case."""
    data = {**config(MODELS[:1]), **changes}
    write_logs(folder / "logs", data, rows)
    import_autodrive(folder / "logs", folder / "run")
    return open_dossier(folder / "run")


def unpack(folder: Path, batches: tuple[int, ...]) -> Path:
    """The published logs of some batches as files."""
    folder.mkdir()
    shutil.copy(PUBLISHED / "config.json", folder)
    for batch in batches:
        with tarfile.open(PUBLISHED / f"batch_{batch}.tar.gz") as archive:
            archive.extractall(folder, filter="data")
    return folder


def cut(folder: Path, batch: int, lines: int) -> None:
    """``head -LINES`` of every log of a batch."""
    for path in (folder / f"batch_{batch}").glob("*.csv"):
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:lines]))


def moving_at_the_end(instance: dict[str, Any]) -> Rows:
    return drive(instance)[:100]


def test_a_log_that_ends_while_the_ego_moves_decides_nothing(tmp_path: Path) -> None:
    dossier = imported(tmp_path, moving_at_the_end)
    assert {(row.status, row.passed, row.no_collision) for row in dossier.rows} == {
        ("unresolved", None, None)
    }
    assert dossier.rows[0].end.reasons == [
        "the log ends after 99.0 s with the ego moving at 1.00 m/s, 49.00 m from the obstacle"
    ]
    # What it holds is still there to look at.
    assert dossier.rows[0].scalar("dtc_min_m") == 49.0
    assert (
        "49.00 m from the obstacle" in make_report(tmp_path / "run", plots=False).page.read_text()
    )


def test_whatever_else_is_imported_it_stays_undecided(tmp_path: Path) -> None:
    def rows(instance: dict[str, Any]) -> Rows:
        whole = drive(instance)
        return whole[:100] if instance == config()["simulation_instances"][0] else whole

    dossier = imported(tmp_path, rows)
    assert [row.status for row in dossier.rows] == ["unresolved", "pass", "pass", "pass"]


def test_a_rest_before_it_moves_on_is_told_and_decides_nothing(tmp_path: Path) -> None:
    def rows(instance: dict[str, Any]) -> Rows:
        far, whole = drive(instance, brake_m=99.0, stop_m=90.0), drive(instance)
        stamps = [row["Timestamp"] for row in whole]
        joined = [*far[:70], *whole[60:]]
        return [{**row, "Timestamp": at} for row, at in zip(joined, stamps, strict=False)][:125]

    reason = imported(tmp_path, rows).rows[0].end.reasons[0]
    assert reason.endswith("from the obstacle; it had come to rest 90.00 m from it before")


def test_a_log_that_was_cut_off_decides_nothing_though_the_ego_rests(tmp_path: Path) -> None:
    """Egos of the study drive on after resting up to 100 s, and its script never ends a log."""
    dossier = imported(tmp_path, lambda instance: drive(instance, stop_m=60.0)[:95])
    assert dossier.rows[0].status == "unresolved"
    assert dossier.rows[0].no_collision is None
    assert dossier.rows[0].end.reasons == [
        "the log ends after 94.0 s with the ego at rest 60.00 m from the obstacle; a log shorter "
        "than 120 s was cut off, and the ego may have driven on"
    ]


def test_logs_that_are_meant_to_be_shorter_say_so_in_the_configuration(tmp_path: Path) -> None:
    rows = imported(
        tmp_path,
        lambda instance: drive(instance, stop_m=60.0)[:95],
        log_s_min=90,
        false_braking_m=70,
    ).rows
    assert [row.status for row in rows] == ["pass"] * 4


@pytest.mark.parametrize(
    ("places", "status"),
    [
        ([0.000, 0.001, 0.000, 0.001], "pass"),  # a millimetre is the resolution
        ([0.000, 0.007, 0.007, 0.007], "pass"),
        ([0.000, 0.010, 0.020, 0.031], "unresolved"),
        ([0.000, 0.267, 0.534, 0.535], "unresolved"),  # one place logged twice is no rest
    ],
)
def test_moving_is_told_from_the_resolution_of_the_logs(
    tmp_path: Path, places: list[float], status: str
) -> None:
    def rows(instance: dict[str, Any]) -> Rows:
        made = drive(instance)
        y = float(made[-1]["PosY (m)"])
        for row, number in zip(made[-4:], range(4), strict=True):
            row["PosY (m)"] = f"{y + places[number]:.3f}"
            row["Timestamp"] = f"2024-03-18 16:37:{44 + 0.3 * number:09.6f}"
        return made

    assert imported(tmp_path, rows).rows[0].status == status


def test_a_log_much_shorter_than_its_neighbours_is_told_on_the_first_screen(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def rows(instance: dict[str, Any]) -> Rows:
        whole = drive(instance)
        return whole[:60] if instance == config()["simulation_instances"][1] else whole

    dossier = imported(tmp_path, rows)
    short, ends = first_screen(dossier)
    assert short == (
        "1 of 4 logs are much shorter than their neighbours (59 to 59 s; those last 130 s) and "
        "look cut off: batch_1/aeb_metrics_sim_inst_2.csv"
    )
    assert ends == (
        "3 of 4 cases passed, 1 unresolved (the log does not decide the case). Without a "
        "collision, the rule of the AutoDRIVE study: 3 of 4, not known of 1."
    )
    assert report_json(tmp_path / "run")["notices"] == [short, ends]
    page = make_report(tmp_path / "run", plots=False).page.read_text()
    assert page.index(short) < page.index("Outcomes by system under test")


def test_a_log_with_a_collision_may_end_when_it_likes(tmp_path: Path) -> None:
    dossier = imported(
        tmp_path,
        lambda instance: (
            drive(instance, brake_m=1, stop_m=0.0)[:149]
            if instance["time_of_day"] == 300
            else [{**row, "Collisions (#)": "1"} for row in drive(instance)[:50]]
        ),
    )
    assert {row.status for row in dossier.rows} == {"collision"}
    assert dossier.imported is not None
    assert dossier.imported.warnings == []


@published
@pytest.mark.parametrize("batch", [1, 2, 7, 8])
def test_truncated_published_logs_never_pass_alone(tmp_path: Path, batch: int) -> None:
    cut(unpack(tmp_path / "logs", (batch,)), batch, 150)
    import_autodrive(tmp_path / "logs", tmp_path / "run")
    dossier = open_dossier(tmp_path / "run")
    assert {row.status for row in dossier.rows} == {"unresolved"}
    assert (dossier.passed, dossier.no_collision) == (0, 0)


@published
def test_truncated_published_logs_never_pass_beside_complete_ones(tmp_path: Path) -> None:
    cut(unpack(tmp_path / "logs", (7, 8)), 8, 150)
    imported = import_autodrive(tmp_path / "logs", tmp_path / "run")
    dossier = open_dossier(tmp_path / "run")
    truncated = [row for row in dossier.rows if row.case.variation.batch == 8]
    assert {row.status for row in truncated} == {"unresolved"}
    assert (len(truncated), dossier.passed) == (32, 25)
    (warning,) = imported.warnings
    assert warning.startswith("32 of 64 logs are much shorter than their neighbours (39 to 51 s;")


@pytest.mark.slow
@published
def test_complete_published_logs_stay_decided(tmp_path: Path) -> None:
    """All but three, which end while the ego moves; these are free of a collision by the study's
    rule and by no other."""
    imported = import_autodrive(PUBLISHED, tmp_path / "run")
    dossier = open_dossier(tmp_path / "run")
    undecided = {row.case.id: row.no_collision for row in dossier.rows if row.passed is None}
    assert undecided == {
        "yolov2-0500-light_rain": True,
        "yolov3-tiny-1100-heavy_rain": True,
        "yolov3-tiny-1300-heavy_rain": True,
    }
    assert imported.warnings == []
    assert first_screen(dossier) == [
        "101 of 128 cases passed, 15 false braking (stopped further than 30 m from the obstacle), "
        "9 collision, 3 unresolved (the log does not decide the case). Without a collision, the "
        "rule of the AutoDRIVE study: 119 of 128."
    ]


def test_the_configuration_may_name_the_campaign_and_a_folder_called_logs_does_not(
    tmp_path: Path,
) -> None:
    study = tmp_path / "Night_Study"
    study.mkdir()
    assert imported(study).campaign.campaign == "night_study-logs"
    named = study / "logs" / "config.json"
    named.write_text(json.dumps({**json.loads(named.read_text()), "campaign": "aeb-demo"}))
    import_autodrive(study / "logs", study / "run")
    assert open_dossier(study / "run").campaign.campaign == "aeb-demo"
    (tmp_path / "opencav_aeb").symlink_to(study / "logs")
    (study / "logs").rename(study / "runs_of_may")
    (tmp_path / "latest").symlink_to(study / "runs_of_may")
    named = study / "runs_of_may" / "config.json"
    named.write_text(json.dumps({**json.loads(named.read_text()), "campaign": ""}))
    import_autodrive(tmp_path / "latest", tmp_path / "run")
    assert open_dossier(tmp_path / "run").campaign.campaign == "runs_of_may"


def test_the_true_reason_of_a_missing_log_is_kept(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    write_logs(logs)
    with (logs / FIRST).open("wb") as sparse:
        sparse.truncate(2 << 30)
    (logs / "batch_1" / "aeb_metrics_sim_inst_2.csv").unlink()
    (logs / "batch_1" / "aeb_metrics_sim_inst_2.csv").symlink_to("aeb_metrics_sim_inst_2.csv")
    (logs / "batch_1" / "aeb_metrics_sim_inst_3.csv").unlink()
    (logs / "batch_1" / "aeb_metrics_sim_inst_3.csv").mkdir()
    shutil.rmtree(logs / "batch_2")
    (logs / "batch_2.tar.gz").write_bytes(b"no archive")
    found = import_autodrive(logs, tmp_path / "run")
    reasons = [row.end.reasons[0] for row in open_dossier(tmp_path / "run").rows]
    large = "has at least 2147483648 bytes, a log at most 67108864"
    assert reasons[:3] == [
        f"{FIRST}: {large}",
        "batch_1/aeb_metrics_sim_inst_2.csv: Too many levels of symbolic links",
        "batch_1/aeb_metrics_sim_inst_3.csv: not a file",
    ]
    assert reasons[4] == (
        "batch_2/aeb_metrics_sim_inst_1.csv: no such file; batch_2.tar.gz: not read to its end, "
        "its logs may be damaged: Not a gzipped file (b'no')"
    )
    assert f"{FIRST}: {large}" in found.left_out
    assert (found.files, report_json(tmp_path / "run")["passed"]) == (1, 1)


def test_names_in_archives_are_escaped_and_never_paths(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    write_logs(logs, config(MODELS[:1]))
    evil = text(drive(config()["simulation_instances"][0])).encode()
    with tarfile.open(logs / "batch_1.tar.gz", "w:gz") as archive:
        for name in ("../evil.csv", f"../{FIRST}", f"/{FIRST}", "batch_1/\x1b[2J\n.csv"):
            member = tarfile.TarInfo(name)
            member.size = len(evil)
            archive.addfile(member, io.BytesIO(evil))
    found = import_autodrive(logs, tmp_path / "run")
    assert all(note.isprintable() for note in found.left_out)
    assert "batch_1.tar.gz/../evil.csv: not the name of a log" in found.left_out
    assert found.files == 4
