"""Command lines that run something in a container; whole, so that a change is seen."""

import shlex
import subprocess

import pytest

from hpc.software.container import Container, mounted, prefix, preparation, removal, shell_lines
from twin.base.errors import UsageError

FOLDERS = ("/work/me", "/work/me/runs/aeb", "/scratch/job 7")


def container(**changes):
    """An image on a shared file system."""
    values = {"image": "/work/me/drivetwin.sif", "binds": FOLDERS, "folder": "/work/me"}
    return Container(**{**values, **changes})


def test_apptainer():
    assert shlex.join(prefix(container())) == (
        "apptainer exec --no-home --bind /work/me --bind '/scratch/job 7' --pwd /work/me "
        "--env PYTHONPATH= --env PYTHONHOME= --env LD_PRELOAD= /work/me/drivetwin.sif"
    )


def test_charliecloud():
    assert shlex.join(prefix(container(image="/work/image", runtime="charliecloud"))) == (
        "ch-run --bind=/work/me '--bind=/scratch/job 7' --cd=/work/me "
        "--unset-env=PYTHONPATH --unset-env=PYTHONHOME --unset-env=LD_PRELOAD "
        "--set-env=PATH=/opt/drivetwin/bin:/usr/local/bin:/usr/bin:/bin /work/image --"
    )


def test_podman():
    assert shlex.join(prefix(container(image="drivetwin:1", runtime="podman"))) == (
        "podman run --rm --init --network=host --ipc=host --userns=keep-id "
        "--security-opt=label=disable --volume=/work/me:/work/me "
        "'--volume=/scratch/job 7:/scratch/job 7' --workdir=/work/me "
        "--env=CUDA_VISIBLE_DEVICES --env=CUDA_DEVICE_ORDER --env=WARP_CACHE_PATH --env=TMPDIR "
        "--env=TZ '--env=SLURM*' '--env=PBS_*' '--env=TWIN_*' '--env=ZENOH_*' "
        "--env=DRIVETWIN_HOME drivetwin:1"
    )


def test_podman_forgets_a_container_that_was_killed():
    words = prefix(container(image="drivetwin:1", runtime="podman", name="drivetwin-7f"))
    assert words[:8] == [
        *("podman", "run", "--rm", "--init", "--network=host", "--ipc=host", "--userns=keep-id"),
        "--name=drivetwin-7f",
    ]
    assert words[8] == "--replace"
    assert removal("podman", "drivetwin-7f") == [
        ["podman", "rm", "--force", "--ignore", "--time=0", "drivetwin-7f"]
    ]
    for runtime in ("apptainer", "charliecloud"):
        assert removal(runtime, "drivetwin-7f") == []
        assert not [word for word in prefix(container(runtime=runtime, name="x1")) if "x1" in word]
    with pytest.raises(UsageError, match="--name '-f': allowed are letters"):
        container(name="-f")


@pytest.mark.parametrize(
    ("runtime", "option"),
    [("apptainer", "--nv"), ("podman", "--device=nvidia.com/gpu=all")],
)
def test_the_driver_comes_in_with_gpus_only(runtime, option):
    assert option in prefix(container(runtime=runtime, gpus=True))
    assert option not in prefix(container(runtime=runtime))


def test_folders_are_made_before_they_are_bound():
    made = ["mkdir", "-p", "--", "/work/me", "/scratch/job 7"]
    assert preparation(container()) == [made]
    assert preparation(container(image="/work/i.sqfs", runtime="charliecloud")) == [made]
    assert preparation(container(binds=())) == []


def test_charliecloud_needs_their_places_inside_too():
    _, *found = preparation(container(image="/work/image", runtime="charliecloud", gpus=True))
    assert found == [
        ["mkdir", "-p", "--", "/work/image/work/me", "/work/image/scratch/job 7"],
        ["ch-fromhost", "--nvidia", "/work/image"],
    ]


def test_a_folder_inside_another_is_bound_once():
    assert mounted(container(binds=("/a/b/", "/a", "/a/b", "/ab"))) == ("/a", "/ab")
    assert mounted(container(binds=("/", "/a"))) == ("/",)


def test_the_script_lines_are_readable():
    assert shell_lines(container()) == [
        "mkdir -p -- /work/me '/scratch/job 7' || exit 2",
        "inside=(",
        "  apptainer",
        "  exec",
        "  --no-home",
        "  --bind /work/me",
        "  --bind '/scratch/job 7'",
        "  --pwd /work/me",
        "  --env PYTHONPATH=",
        "  --env PYTHONHOME=",
        "  --env LD_PRELOAD=",
        "  /work/me/drivetwin.sif",
        ")",
    ]


@pytest.mark.parametrize("runtime", ["apptainer", "charliecloud", "podman"])
def test_bash_reads_the_same_words(runtime):
    """A real shell, with a folder whose name it could take apart."""
    odd = container(
        runtime=runtime, binds=("/tmp/a $(b) 'c'",), folder="/tmp/a $(b) 'c'", gpus=True
    )
    lines = [line for line in shell_lines(odd) if not line.endswith("exit 2")]
    assert ("export USER" in lines[0]) == (runtime == "charliecloud")
    script = "\n".join([*lines, r"""printf '%s\0' "${inside[@]}" """])
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split("\0")[:-1] == prefix(odd)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"image": ""}, "give the path of an image"),
        ({"image": "--nv"}, "give the path of an image"),
        ({"image": "drivetwin.sif"}, "absolute path"),
        ({"runtime": "docker"}, "apptainer, charliecloud, podman"),
        ({"binds": ("runs",)}, "absolute path"),
        ({"binds": ("/a:/b",)}, "no ':'"),
        ({"binds": ("/a,b",)}, "no ':'"),
        ({"folder": "."}, "absolute path"),
    ],
)
def test_one_line_errors(changes, said):
    with pytest.raises(UsageError, match=said) as raised:
        container(**changes)
    assert "\n" not in str(raised.value)
