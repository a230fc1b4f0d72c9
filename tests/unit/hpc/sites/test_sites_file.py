"""The sites file: what it may say, and whose it must be."""

import os

import pytest

from hpc.sites.file import chosen_sites, load_sites
from twin.base.errors import UsageError

GOOD = """\
sites:
  north: {scheduler: slurm, ssh: me@login.north, folder: /home/me/dt, bin: /opt/bin, workers: 2}
  south: {scheduler: pbs, gpus: 1, cost: 0.5}
  pool: {scheduler: kubernetes, directives: [--image=a:1]}
"""


def load(tmp_path, text, mode=0o600):
    path = tmp_path / "sites.yaml"
    path.write_text(text)
    path.chmod(mode)
    return load_sites(path)


def test_chosen(tmp_path):
    file = load(tmp_path, GOOD)
    assert file.listen == "tls/0.0.0.0:0"
    found = chosen_sites(["k8s:pool", "slurm:north"], file)
    assert [(site.name, site.scheduler) for site in found] == [
        ("pool", "kubernetes"),
        ("north", "slurm"),
    ]
    assert found[1].place.reach == ("ssh", "-o", "BatchMode=yes", "--", "me@login.north")
    assert found[0].place.reach == ()


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("north", "expected KIND:SITE"),
        ("lsf:north", "expected KIND:SITE"),
        ("slurm:nowhere", "no site 'nowhere'; the file has north, south, pool"),
        ("pbs:north", "the file says that north has slurm"),
    ],
)
def test_not_chosen(tmp_path, word, said):
    with pytest.raises(UsageError, match=said) as error:
        chosen_sites([word], load(tmp_path, GOOD))
    assert "\n" not in str(error.value)


def test_a_site_is_named_once(tmp_path):
    with pytest.raises(UsageError, match="given twice"):
        chosen_sites(["pbs:south", "pbs:south"], load(tmp_path, GOOD))


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{scheduler: lsf}", "allowed are slurm, pbs, kubernetes"),
        ("{scheduler: slurm, shh: a}", "shh"),
        ("{scheduler: slurm, ssh: -oProxyCommand=evil, folder: /a, bin: /b}", "ssh"),
        ("{scheduler: slurm, ssh: 'a b', folder: /a, bin: /b}", "ssh"),
        ("{scheduler: slurm, ssh: a}", "say its folder and its bin"),
        ("{scheduler: slurm, ssh: a, reach: [sh, -c], folder: /a, bin: /b}", "ssh or reach"),
        ("{scheduler: slurm, folder: jobs}", "give an absolute path"),
        ("{scheduler: slurm, workers: 1, gpus: 1}", "workers or gpus"),
        ("{scheduler: slurm, connect: tcp/a:1}", "connect"),
        ("{scheduler: slurm, connect: tls/a}", "connect"),
        ("{scheduler: slurm, allocations: 0}", "allocations"),
        ("{scheduler: slurm, allocations: 1001}", "allocations"),
        ("{scheduler: slurm, cost: -1}", "cost"),
    ],
)
def test_mistakes(tmp_path, entry, said):
    with pytest.raises(UsageError, match=said):
        load(tmp_path, f"sites: {{north: {entry}}}")


@pytest.mark.parametrize(
    ("store", "said"),
    [
        ("/shared/results", "expected a URL that every site reaches, e.g. s3://BUCKET/PREFIX"),
        ("file:///shared/results", "expected a URL that every site reaches"),
        ("s3://key:hidden@bucket/night", "credentials in a URL"),
        ("ftp://host/night", "no store of this scheme"),
        ("s3://", "names no bucket"),
        ("s3://b/\\e[2J", "expected a URL"),
    ],
)
def test_a_store_that_sites_do_not_reach(tmp_path, store, said):
    with pytest.raises(UsageError) as caught:
        load(tmp_path, f'store: "{store}"\n{GOOD}')
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{tmp_path}/sites.yaml: store ")
    assert said in line
    assert "hidden" not in line
    assert line.isprintable()


@pytest.mark.parametrize("name", ["a b", "a/b", "-a", "a" * 33, "a.b", "a;b"])
def test_names(tmp_path, name):
    with pytest.raises(UsageError, match="1 to 32 letters"):
        load(tmp_path, f"sites: {{'{name}': {{scheduler: slurm}}}}")


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_may_write_is_not_believed(tmp_path, mode):
    with pytest.raises(UsageError, match="others may write it"):
        load(tmp_path, GOOD, mode)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to give a file away")
def test_a_file_of_somebody_else_is_not_believed(tmp_path):
    path = tmp_path / "sites.yaml"
    path.write_text(GOOD)
    os.chown(path, 4242, 4242)
    # Root asks as another user would: its own files are root's.
    with pytest.raises(UsageError, match="others may write it"):
        load_sites(path)


def test_no_file(tmp_path):
    with pytest.raises(UsageError, match="says which sites there are"):
        load_sites(None, {"DRIVETWIN_HOME": str(tmp_path)})
    with pytest.raises(UsageError, match="no regular file"):
        load_sites(tmp_path)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "sites.yaml", 0o600)
    with pytest.raises(UsageError, match="no regular file"):
        load_sites(tmp_path / "sites.yaml")
