"""The site file: every mistake with its place, and options that win over it."""

import subprocess
import sys

import pytest
from waiting import PATIENCE_S

from hpc.site import Site, load_site
from schemas.kinds.batch_system import batch_systems
from twin.base.errors import UsageError

FULL = """\
scheduler: pbs
partition: gpu
account: proj-1
constraint: model=milan
interface: ib0
modules: [cuda/12.4, python/3.11]
scratch: $TMPDIR
cpus_per_worker: 6
directives: ["-W group_list=robots"]
"""


def test_no_file_presets_nothing(tmp_path):
    assert load_site(None, {"XDG_CONFIG_HOME": str(tmp_path)}) == Site()


def test_the_users_file_is_found(tmp_path):
    folder = tmp_path / "drivetwin"
    folder.mkdir()
    (folder / "site.yaml").write_text("partition: gpu\n")
    assert load_site(None, {"XDG_CONFIG_HOME": str(tmp_path)}) == Site(partition="gpu")


def test_an_empty_file_presets_nothing(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("# nothing yet\n")
    assert load_site(path) == Site()


NAMES = ", ".join(sorted(("auto", *batch_systems().names())))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("partitoin: gpu\n", ["partitoin: unknown key", "did you mean 'partition'?", "account"]),
        (
            "scheduler: lsf\n",
            ["scheduler: given 'lsf'", NAMES],
        ),
        ("cpus_per_worker: 0\n", ["cpus_per_worker: given 0", ">= 1"]),
        ("modules: cuda\n", ["modules: given 'cuda', expected a list"]),
        ("directives: [1]\n", ["directives[0]: given 1"]),
        ("partition: a\npartition: b\n", ["appears twice"]),
        ("- a\n", ["expected a mapping"]),
    ],
)
def test_mistakes_name_file_and_place(tmp_path, text, said):
    path = tmp_path / "site.yaml"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        load_site(path)
    for words in [str(path), *said]:
        assert words in str(caught.value)


def test_a_file_that_is_named_must_be_there(tmp_path):
    with pytest.raises(UsageError, match=r"none\.yaml: No such file"):
        load_site(tmp_path / "none.yaml")


def test_everything_reaches_the_script_and_options_win(tmp_path):
    (tmp_path / "site.yaml").write_text(FULL)
    asked = ("render", "aeb-demo", "--gpus", "2", "--time", "1:00", "--site", "site.yaml")
    done = subprocess.run(
        [sys.executable, "-m", "hpc", *asked, "--partition", "long"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    for words in (
        "#PBS -q long\n",
        "#PBS -A proj-1\n",
        "#PBS -l select=2:ncpus=6:ngpus=1:mpiprocs=1:model=milan\n",
        "#PBS -W group_list=robots\n",
        "module load cuda/12.4 python/3.11 ||",
        'TMPDIR="$TMPDIR/drivetwin-$UID"',
        "address show dev ib0 ",
    ):
        assert words in done.stdout
