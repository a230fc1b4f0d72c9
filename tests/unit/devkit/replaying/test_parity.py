"""devkit.replaying.parity: the AutoDRIVE rules on their published logs; poor rows."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import pytest

from devkit.replaying.parity import Parity, judge, run_parity
from twin.base.errors import UsageError

PUBLISHED = Path(__file__).parents[5] / "shared" / "data" / "autodrive_opencav_aeb"
"""Beside the project, not in it."""

HEADER = "Timestamp,Model,Label,Confidence (%),Size (px^2),AEB (bool),DTC (m),Collisions (#)\n"


def rows(*given: str, end: str = "\n") -> Parity:
    """Parity of a log with rows ``label,confidence,size,aeb``."""
    parity = Parity()
    text = "\n".join(f"2024-03-18 16:38:40.1,yolov2,{row},14.34,0" for row in given)
    judge("a.csv", HEADER + text + end, parity)
    return parity


@pytest.mark.skipif(
    not PUBLISHED.is_dir(), reason=f"the published logs are not beside the project: {PUBLISHED}"
)
def test_every_row_of_the_published_logs_agrees():
    found = run_parity(PUBLISHED)
    assert (found.files, found.rows, found.agreeing) == (128, 64_154, 64_154)
    assert found.by_model == {"yolov2": [29_295, 29_295], "yolov3-tiny": [34_859, 34_859]}
    assert found.disagreements == found.unreadable == []


@pytest.mark.parametrize(
    ("row", "aeb"),
    [
        ("car,50.0,1000", 1),
        ("car,49.99,1000", 0),
        ("car,50.0,999", 0),
        ("car,99.9,100000", 1),
        ("truck,99.9,100000", 0),
        (",0.0,", 0),
        (",,", 0),
        (",63.2,", 0),
    ],
)
def test_the_limits_of_the_rule(row, aeb):
    found = rows(f"{row},{aeb}", f"{row},{1 - aeb}")
    assert (found.rows, found.agreeing) == (2, 1)
    (wrong,) = found.disagreements
    assert (wrong.file, wrong.line, wrong.rule, wrong.logged) == ("a.csv", 3, bool(aeb), not aeb)


def test_a_disagreement_shows_what_was_logged():
    (wrong,) = rows("car,60.05,1200,0").disagreements
    assert (wrong.label, wrong.confidence_percent, wrong.size_px2) == ("car", 60.05, 1200.0)


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("car,,1200,1", "a box without Confidence (%)"),
        ("car,70,,1", "a box without Size (px^2)"),
        (",70,1200,1", "a box without Label"),
        ("car,high,1200,1", "Confidence (%): given 'high', expected a number of 0 or more"),
        ("car,70,nan,1", "Size (px^2): given 'nan', expected a number of 0 or more"),
        ("car,70,-5,1", "Size (px^2): given '-5', expected a number of 0 or more"),
        ("car,70,1200,", "AEB (bool): given '', expected 0 or 1"),
        ("car,70,1200", "torn: 7 of 8 values"),
        ("car,70,1200,1,9", "torn: 9 of 8 values"),
    ],
)
def test_rows_with_gaps_are_listed_and_not_counted(row, reason):
    found = rows("car,70,1200,1", row, ",0.0,,0")
    assert (found.rows, found.agreeing) == (2, 2)
    assert [(u.file, u.line, u.reason) for u in found.unreadable] == [("a.csv", 3, reason)]


def test_a_last_line_that_was_cut_off_is_listed():
    whole = HEADER + "t,yolov2,car,70.0,1200,1,14.34,0\n" * 2
    for cut in range(1, len("t,yolov2,car,70.0,1200,1,14.34,0\n")):
        parity = Parity()
        judge("a.csv", whole[:-cut], parity)
        if cut <= 2:  # all values are there, and the ones that matter are whole
            assert (parity.rows, parity.unreadable) == (2, [])
            continue
        assert parity.rows == 1
        ((line, reason),) = [(u.line, u.reason) for u in parity.unreadable]
        assert line == 3
        assert reason.startswith("cut off: ")


def test_a_cut_off_value_that_matters_is_not_judged():
    parity = Parity()
    judge(
        "a.csv", "AEB (bool),Label,Confidence (%),Size (px^2)\n1,car,70,1200\n1,car,70,12", parity
    )
    assert (parity.rows, parity.agreeing) == (1, 1)
    assert [(u.line, u.reason) for u in parity.unreadable] == [(3, "cut off: 4 of 4 values")]


def test_logs_of_something_else():
    parity = Parity()
    judge("a.csv", "a,b\n1,2\n", parity)
    judge("b.csv", "", parity)
    assert [(u.file, u.line) for u in parity.unreadable] == [("a.csv", 1), ("b.csv", 1)]
    assert "no column Label, Confidence (%)" in parity.unreadable[0].reason


def test_columns_may_come_in_any_order_and_windows_line_ends():
    parity = Parity()
    text = "AEB (bool),Size (px^2),Label,Confidence (%)\r\n1,1000,car,50\r\n0,1000,car,50\r\n"
    judge("a.csv", text, parity)
    assert (parity.rows, parity.agreeing) == (2, 1)
    assert parity.disagreements[0].line == 3
    assert parity.unreadable == []


ROW = "t,yolov2,car,70,1200,1,1,0\n"
INSTANCE_1 = "aeb_metrics_sim_inst_1.csv"


def pack(path: Path, members: dict[str, bytes]) -> None:
    with tarfile.open(path, "w:gz") as archive:
        for name, data in members.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))


def write(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)


def test_folders_and_archives(tmp_path):
    with pytest.raises(UsageError, match="no such folder"):
        run_parity(tmp_path / "none")
    with pytest.raises(UsageError, match="no log batch_N"):
        run_parity(tmp_path)
    write(tmp_path / "batch_1" / INSTANCE_1, b"a\n")
    with pytest.raises(UsageError, match="1 logs, but no row"):
        run_parity(tmp_path)
    log = (HEADER + ROW).encode()
    write(tmp_path / "batch_2" / INSTANCE_1, log)
    other = log + ROW.replace("1200,1", "1200,0").encode()
    pack(tmp_path / "batch_3.tar.gz", {f"./batch_3/{INSTANCE_1}": other})
    found = run_parity(tmp_path)
    assert (found.files, found.rows, found.agreeing) == (3, 3, 2)
    assert found.disagreements[0].file == f"batch_3/{INSTANCE_1}"
    assert run_parity(tmp_path / "batch_2").rows == 1  # a batch by itself


def test_names_that_are_not_logs_are_not_logs(tmp_path):
    log = (HEADER + ROW).encode()
    foreign = ("../evil.csv", f"../batch_1/{INSTANCE_1}", f"/batch_1/{INSTANCE_1}", "notes.csv")
    hostile = "batch_1/\x1b[2J\nx.csv"
    pack(
        tmp_path / "batch_1.tar.gz",
        {f"batch_1/{INSTANCE_1}": log, **dict.fromkeys((*foreign, hostile), log)},
    )
    write(tmp_path / "batch_2" / "notes.csv", log)
    write(tmp_path / "summary.csv", log)
    found = run_parity(tmp_path)
    assert (found.files, found.rows) == (1, 1)
    assert [refused.file for refused in found.refused] == [
        *(f"batch_1.tar.gz/{name}" for name in foreign),
        "batch_1.tar.gz/batch_1/\\x1b[2J\\nx.csv",
        "batch_2/notes.csv",
    ]
    assert {refused.reason for refused in found.refused} == {"not the name of a log"}


def test_a_large_or_damaged_file_is_one_line_and_the_rest_goes_on(tmp_path):
    log = (HEADER + ROW).encode()
    write(tmp_path / "batch_1" / INSTANCE_1, log)
    with (tmp_path / "batch_1" / "aeb_metrics_sim_inst_2.csv").open("wb") as sparse:
        sparse.truncate(2 << 30)
    (tmp_path / "batch_1" / "aeb_metrics_sim_inst_3.csv").mkdir()
    (tmp_path / "batch_1" / "aeb_metrics_sim_inst_4.csv").symlink_to(tmp_path / "none")
    write(tmp_path / "batch_2.tar.gz", b"no archive")
    pack(tmp_path / "batch_3.tar.gz", {f"batch_3/{INSTANCE_1}": log})
    pack(tmp_path / "batch_1.tar.gz", {f"batch_1/{INSTANCE_1}": log})
    found = run_parity(tmp_path)
    assert (found.files, found.rows, found.agreeing) == (2, 2, 2)
    said = {refused.file: refused.reason for refused in found.refused}
    assert said == {
        "batch_1/aeb_metrics_sim_inst_2.csv": "has at least 2147483648 bytes, a log at most "
        "67108864",
        "batch_1/aeb_metrics_sim_inst_3.csv": "not a file",
        "batch_1/aeb_metrics_sim_inst_4.csv": "No such file or directory",
        f"batch_1/{INSTANCE_1}": "is there a second time; the first one counts",
        "batch_2.tar.gz": "not read to its end, its logs may be damaged: Not a gzipped file "
        "(b'no')",
    }


def test_texts_of_a_log_are_escaped():
    parity = Parity()
    judge(
        "a.csv",
        HEADER + "t,\x1b[2Jyolo,\x1b]0;pwned\x07,70,1200,1,1,0\nt,m,car,\x1b[31m,1200,1,1,0\n",
        parity,
    )
    assert list(parity.by_model) == ["\\x1b[2Jyolo"]
    assert parity.disagreements[0].label == "\\x1b]0;pwned\\x07"
    assert parity.unreadable[0].reason.isprintable()
