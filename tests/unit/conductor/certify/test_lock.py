"""What was installed, and how somebody else gets the same."""

from __future__ import annotations

import json
import subprocess
import sys

import msgspec
import pytest
from certificates import made

from conductor.certify.lock import (
    DISTRIBUTIONS_MAX,
    Distribution,
    decode_lock,
    differences,
    encode_lock,
    installed,
    requirements,
    with_archives,
)
from twin.base.errors import InfrastructureError, UsageError

ONE = Distribution(name="numpy", version="2.4.6", record="1" * 64)


def report(*entries: tuple[str, str, str]) -> str:
    """A report of ``pip install --report`` about distributions."""
    install = [
        {
            "metadata": {"name": name, "version": version, "more": 1},
            "download_info": {"url": "x", "archive_info": {"hashes": {"sha256": sha}}},
        }
        for name, version, sha in entries
    ]
    return json.dumps({"version": "1", "pip_version": "26", "install": install})


def test_it_lists_what_pip_lists():
    words = [sys.executable, "-m", "pip", "list", "--format", "json", "--disable-pip-version-check"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    listed = {
        each["name"].lower().replace("_", "-").replace(".", "-") for each in json.loads(done.stdout)
    }
    assert {each.name for each in installed()} == listed - {"drivetwin"}


def test_it_is_read_as_it_was_written():
    lock = installed()
    assert decode_lock(encode_lock(lock), "c.cert") == lock
    assert len(made().lock) > 10


def test_differences_are_named():
    here = [msgspec.structs.replace(ONE, version="3.0")]
    assert differences([ONE], here) == ["numpy 2.4.6: here 3.0"]
    assert differences([ONE], []) == ["numpy 2.4.6: not installed here"]
    other = [msgspec.structs.replace(ONE, record="2" * 64)]
    assert differences([ONE], other) == ["numpy 2.4.6: its files here are others"]
    assert differences([ONE], [ONE, Distribution(name="more", version="1", record="0" * 64)]) == []


def test_hashes_of_archives_come_from_a_report_of_pip(tmp_path):
    path = tmp_path / "report.json"
    path.write_text(report(("NumPy", "2.4.6", "a" * 64)))
    (hashed,) = with_archives([ONE], path)
    assert requirements([hashed]) == f"numpy==2.4.6 --hash=sha256:{'a' * 64}\n"
    assert requirements([ONE]) == "numpy==2.4.6\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (report(("numpy", "2.4.5", "a" * 64)), "has no hash of numpy 2.4.6, which is installed"),
        (report(), "has no hash of numpy 2.4.6"),
        (report(("numpy", "2.4.6", "zz")), "its lock"),
        (report(("numpy", "2.4.6", "a" * 64 + "\n--index-url http://x")), "its lock"),
        ("{}", "no report of pip"),
        ("[" * 10_000, "no report of pip"),
        ("", "no report of pip"),
    ],
)
def test_a_report_that_does_not_fit(tmp_path, text, words):
    path = tmp_path / "report.json"
    path.write_text(text)
    with pytest.raises((UsageError, InfrastructureError), match=words):
        with_archives([ONE], path)


@pytest.mark.parametrize(
    "entry",
    [
        {"name": "numpy --index-url http://x", "version": "1", "record": "0" * 64},
        {"name": "numpy\n-e .", "version": "1", "record": "0" * 64},
        {"name": "-e", "version": "1", "record": "0" * 64},
        {"name": "numpy", "version": "1\n-r /etc/passwd", "record": "0" * 64},
        {"name": "numpy", "version": "1 --pre", "record": "0" * 64},
        {"name": "numpy", "version": "1 ; python_version>'3'", "record": "0" * 64},
        {"name": "numpy", "version": "1", "record": "0" * 64, "archives": ["x"]},
        {"name": "numpy", "version": "1", "record": "0" * 64, "archives": ["0" * 64] * 101},
        {"name": "numpy", "version": "1", "record": "0" * 64, "url": "http://x"},
    ],
)
def test_a_lock_holds_nothing_but_names_versions_and_hashes(entry):
    """Its lines are given to pip by who audits."""
    with pytest.raises(InfrastructureError, match="its lock"):
        decode_lock(json.dumps([entry]).encode(), "c.cert")


def test_a_lock_has_a_bound():
    many = encode_lock([ONE] * (DISTRIBUTIONS_MAX + 1))
    with pytest.raises(InfrastructureError, match="its lock"):
        decode_lock(many, "c.cert")
