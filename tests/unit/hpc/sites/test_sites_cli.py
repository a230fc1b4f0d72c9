"""``hpc submit --on`` and ``hpc scale`` as a user who mistypes meets them."""

import shutil
import subprocess
import sys

import pytest
from waiting import PATIENCE_S

from conductor.core.state import State
from conductor.stored.link import StoreLink, StoreOptions
from conductor.stored.owner import StoreClaims
from conductor.stored.seals import StoreSeal
from hpc.campaigns import CampaignFacts
from hpc.sites.requests import check_campaign, mark_of, store_of
from twin.base.errors import UsageError
from twin.stores.folder import FolderStore

SITES = """\
sites:
  north: {scheduler: slurm, workers: 1}
  south: {scheduler: pbs, workers: 1, ssh: login.south, folder: /home/me, bin: /opt/bin}
"""
STORED = """\
store: s3://results/runs
sites:
  pool:
    scheduler: kubernetes
    connect: tls/node:7447
    workers: 1
    directives: [--image=registry/drivetwin:1, --store-secret=bucket]
"""
ONE = "--target 0:1 --on slurm:north --sites sites.yaml"


def hpc(*arguments, folder):
    """Run the command in ``folder``."""
    return subprocess.run(
        [sys.executable, "-m", "hpc", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("scale runs/x --target 1:2 --sites sites.yaml", 2, "where? give --on KIND:SITE"),
        ("scale runs/x --target 2:1 --on slurm:north --sites sites.yaml", 2, "expected MIN:MAX"),
        ("scale runs/x --target 0:1 --on slurm:east --sites sites.yaml", 2, "no site 'east'"),
        ("scale runs/x --target 0:1 --on slurm:north --sites nowhere.yaml", 2, "nowhere.yaml: No"),
        (f"scale runs/x {ONE}", 2, "site north: --time HH:MM is missing"),
        (f"scale runs/x {ONE} --time 1:00", 2, "no such run folder"),
        (f"scale old {ONE} --time 1:00", 3, "no conductor serves"),
        (f"scale runs/x {ONE} --time 1:00 --key k", 2, "no such key"),
        (
            "submit aeb-demo --on slurm:north --sites sites.yaml --time 1:00 --partition gpu",
            2,
            "--partition: differs from site to site",
        ),
        (
            "submit aeb-demo --on slurm:north --sites sites.yaml --time 1:00 --history old",
            2,
            "--history old: no outcomes.json there",
        ),
        (
            "submit aeb-demo --on slurm:north --sites sites.yaml --time 0:01",
            2,
            "site north: --time",
        ),
    ],
)
def test_one_line(tmp_path, words, code, said):
    (tmp_path / "sites.yaml").write_text(SITES)
    (tmp_path / "sites.yaml").chmod(0o600)
    (tmp_path / "old").mkdir()
    done = hpc(*words.split(), folder=tmp_path)
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert not (tmp_path / "runs").exists(), "nothing is left behind"


def test_sites_whose_workers_put_into_a_store_are_scaled(tmp_path):
    (tmp_path / "sites.yaml").write_text(STORED)
    (tmp_path / "sites.yaml").chmod(0o600)
    words = "scale runs/x --target 0:1 --on k8s:pool --sites sites.yaml --time 1:00"
    done = hpc(*words.split(), folder=tmp_path)
    assert "no such run folder" in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"remote_stacks": True}, "autonomy.placement: node"),
        ({"records": True}, r"recordings \(view: record\).* name a store in the sites file"),
        ({"records": True, "drive_records": True}, "recording.drive: .* no store has such"),
        ({"files": ("a.onnx", "b.yaml")}, "names a.onnx, b.yaml, which other sites do not see"),
    ],
)
def test_campaigns_that_need_a_shared_disk(change, said):
    facts = {"name": "mine", "cases": ("a",), "deadline_s": 60.0, "remote_stacks": False}
    check_campaign(CampaignFacts(**facts))
    with pytest.raises(UsageError, match=said):
        check_campaign(CampaignFacts(**{**facts, **change}))


def test_recordings_go_where_a_store_takes_them():
    facts = {"name": "mine", "cases": ("a",), "deadline_s": 60.0, "remote_stacks": False}
    check_campaign(CampaignFacts(**facts, records=True), "s3://bucket/night")
    with pytest.raises(UsageError, match="no store has such"):
        check_campaign(CampaignFacts(**facts, records=True, drive_records=True), "s3://bucket/x")


def test_each_run_has_a_store_of_its_own(tmp_path, monkeypatch):
    """From each host that sees the folder; removed and used again, it is another run."""
    out = tmp_path / "aeb"

    def url():
        out.mkdir(exist_ok=True)
        return store_of("s3://bucket/night/", out, mark_of(out))

    one = url()
    assert one.startswith("s3://bucket/night/aeb-")
    monkeypatch.setattr("socket.gethostname", lambda: "login2")
    assert url() == one
    shutil.rmtree(out)
    assert url() != one
    assert store_of("", out, "0") == ""
    (out / "store.id").write_text("torn")
    with pytest.raises(UsageError, match="damaged"):
        mark_of(out)


def test_a_conductor_takes_the_mark_of_a_run_for_its_claim(tmp_path):
    mark = mark_of(tmp_path)
    StoreLink(StoreOptions(str(tmp_path / "store")), tmp_path, None).claim(State())
    store = FolderStore(tmp_path / "store")
    _, owner = StoreClaims(store, StoreSeal(store, None)).latest()
    assert owner is not None
    assert owner.lease[:8] == mark
