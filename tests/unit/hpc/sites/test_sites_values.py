"""A bad value of every key of the sites file: one line that says which key of which site."""

from pathlib import Path

import pytest

from hpc.backends import backend
from hpc.sites.file import SiteEntry, SitesFile, chosen_sites, load_sites
from hpc.sites.requests import CommonOptions, request_of
from twin.base.errors import UsageError

GOOD = {
    "slurm": "scheduler: slurm, workers: 1, time: '01:00', bin: /opt/bin",
    "kubernetes": "scheduler: kubernetes, workers: 1, time: '01:00', directives: [--image=a:1]",
}
ENTRIES = {
    "scheduler": ("lsf", "sites.north.scheduler 'lsf': allowed are slurm, pbs, kubernetes"),
    "ssh": ("-oProxyCommand=x", "sites.north.ssh: given '-oProxyCommand=x'"),
    "reach": ("nsenter", "sites.north.reach: given 'nsenter', expected a list"),
    "dials_out": ("maybe", "sites.north.dials_out: given 'maybe'"),
    "connect": ("tcp/a:1", "sites.north.connect: given 'tcp/a:1'"),
    "kubeconfig": ("pool", "sites.north.kubeconfig 'pool': give an absolute path"),
    "folder": ("jobs", "sites.north.folder 'jobs': give an absolute path"),
    "bin": ("bin", "sites.north.bin 'bin': give an absolute path"),
    "workers": ("-1", "sites.north.workers: given -1"),
    "gpus": ("5000", "sites.north.gpus: given 5000"),
    "time": ("1h", "site north: --time '1h': expected HH:MM"),
    "slots": ("0", "sites.north.slots: given 0"),
    "allocations": ("0", "sites.north.allocations: given 0"),
    "queued": ("1001", "sites.north.queued: given 1001"),
    "cost": (".nan", "sites.north.cost: given"),
    "partition": ("a b", "site north: --partition 'a b': allowed are"),
    "account": ("$(id)", "site north: --account '$(id)': allowed are"),
    "constraint": ("a b", "site north: --constraint 'a b': allowed are"),
    "modules": ("[a;b]", "site north: module 'a;b': expected a name"),
    "scratch": ("tmp", "site north: --scratch 'tmp': expected an absolute path"),
    "cpus_per_worker": ("0", "sites.north.cpus_per_worker: given 0"),
    "directives": ("[qos]", "site north: directive 'qos': expected an option"),
    "container": ("x.sif", "sites.north.container 'x.sif': give an absolute path"),
    "container_runtime": ("docker", "sites.north.container_runtime: given 'docker'"),
}
"""By key: YAML of its value, and what is said."""
PODS = {
    "account": ("proj", "--account: Kubernetes knows none"),
    "modules": ("[cuda]", "modules (site file): the image has all software"),
    "scratch": ("/tmp", "--scratch: pods have their own /tmp"),
    "container": ("/x.sif", "--container: give --directive=--image=NAME"),
    "container_runtime": ("podman", "--container-runtime: nodes have their own"),
    "partition": ("Gpu", "--partition 'Gpu': expected a local queue"),
    "constraint": ("a100", "--constraint 'a100': expected labels of nodes"),
    "directives": ("[--image=A]", "--image 'A': expected an image"),
}
"""The same, where the site is a Kubernetes."""
FILE = {
    "listen": ("listen: tcp/0.0.0.0:1\nsites: {}\n", "listen: given 'tcp/0.0.0.0:1'"),
    "store": ("store: /shared\nsites: {}\n", "store /shared: expected a URL that every site"),
    "sites": ("sites: []\n", "sites: given"),
}


def script(path):
    """Of an allocation at the one site of a file."""
    file = load_sites(path)
    (name,) = file.sites
    (site,) = chosen_sites([f"{file.sites[name].scheduler}:{name}"], file)
    place = {"campaign": "aeb-demo", "out": Path("/o"), "connect": "tls/a:1"}
    request = request_of(site, "north-1", common=CommonOptions(), **place)
    return backend(site.scheduler).render(request)


def refused(folder, text):
    """What is said of a sites file, by the time that a script for its site would be written."""
    path = folder / "sites.yaml"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(UsageError) as caught:
        script(path)
    (line,) = str(caught.value).splitlines()
    return line


def entry(kind, key, value):
    words = [word for word in GOOD[kind].split(", ") if not word.startswith(f"{key}:")]
    return f"sites: {{north: {{{', '.join([*words, f'{key}: {value}'])}}}}}\n"


def test_every_key_has_a_row():
    assert {*ENTRIES} == {*SiteEntry.__struct_fields__}
    assert {*FILE} == {*SitesFile.__struct_fields__}


@pytest.mark.parametrize("key", ENTRIES)
def test_a_bad_value(tmp_path, key):
    value, said = ENTRIES[key]
    assert said in refused(tmp_path, entry("slurm", key, value))


@pytest.mark.parametrize("key", PODS)
def test_what_a_site_of_pods_has_no_use_for(tmp_path, key):
    value, said = PODS[key]
    assert said in refused(tmp_path, entry("kubernetes", key, value))


@pytest.mark.parametrize("key", FILE)
def test_a_bad_value_of_the_file(tmp_path, key):
    text, said = FILE[key]
    assert said in refused(tmp_path, text)


@pytest.mark.parametrize("key", ["ssh", "connect"])
def test_a_line_break_at_the_end(tmp_path, key):
    value = {"ssh": '"me@host\\n"', "connect": '"tls/a:1\\n"'}[key]
    assert f"sites.north.{key}: given" in refused(tmp_path, entry("slurm", key, value))


@pytest.mark.parametrize("key", ["folder", "bin", "container", "kubeconfig", "time", "partition"])
def test_a_line_break_inside(tmp_path, key):
    assert "\\n" in refused(tmp_path, entry("slurm", key, '"/a\\nb"')), "escaped, in one line"
