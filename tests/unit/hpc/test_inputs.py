"""Repositories and images fetched before submission: real git, local repositories, no network."""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from hpc import inputs
from hpc.inputs import NamedRepository, fetch_image, fetch_repository
from twin.base.errors import InfrastructureError, UsageError


@pytest.fixture(autouse=True)
def _plain_git(monkeypatch, tmp_path):
    """No configuration of this machine's user."""
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", os.devnull)
    monkeypatch.setenv("GIT_CONFIG_SYSTEM", os.devnull)
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", "somebody")
        monkeypatch.setenv(f"GIT_{role}_EMAIL", "somebody@example.org")


def git(*words, folder):
    """A git command; its output."""
    done = subprocess.run(["git", *words], cwd=folder, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(folder, text):
    """A commit that changes a file; its id."""
    (folder / "stack.py").write_text(text)
    git("add", "-A", folder=folder)
    git("commit", "-q", "-m", text, folder=folder)
    return git("rev-parse", "HEAD", folder=folder)


@pytest.fixture
def work(tmp_path):
    """A working clone with one commit on the branch ``main``."""
    folder = tmp_path / "work"
    folder.mkdir()
    git("init", "-q", "-b", "main", folder=folder)
    run = folder / "run.sh"
    run.write_text("#!/bin/sh\n")
    run.chmod(0o755)
    commit(folder, "one")
    return folder


@pytest.fixture
def bare(work, tmp_path):
    """Its bare clone."""
    git("clone", "-q", "--bare", str(work), "bare.git", folder=tmp_path)
    return tmp_path / "bare.git"


@pytest.fixture
def cache(tmp_path):
    return tmp_path / "cache"


def leftovers(cache):
    return [path.name for path in cache.rglob("*.partial")]


def test_a_bare_clone_is_fetched_read_only(bare, work, cache):
    found = fetch_repository(NamedRepository(str(bare), "main"), cache)
    assert found.commit == git("rev-parse", "HEAD", folder=work)
    assert (found.folder / "stack.py").read_text() == "one"
    assert not (found.folder / ".git").exists()
    modes = {path.stat().st_mode & 0o777 for path in (found.folder, *found.folder.rglob("*"))}
    assert modes == {0o555, 0o444}
    assert os.access(found.folder / "run.sh", os.X_OK)
    assert '"ref": "main"' in (found.folder.parent / "input.json").read_text()
    assert not leftovers(cache)


def test_the_same_content_is_fetched_once(bare, cache):
    first = fetch_repository(NamedRepository(str(bare), "main", "date +%N > when"), cache)
    when = (first.folder / "when").read_text()
    again = fetch_repository(NamedRepository(str(bare), "main", "date +%N > when"), cache)
    assert again == first
    assert (again.folder / "when").read_text() == when


def test_a_branch_that_moved_is_another_entry(bare, work, cache):
    first = fetch_repository(NamedRepository(str(bare), "main"), cache)
    commit(work, "two")
    git("push", "-q", str(bare), "main", folder=work)
    second = fetch_repository(NamedRepository(str(bare), "main"), cache)
    assert second.key != first.key
    assert (first.folder / "stack.py").read_text() == "one"
    assert (second.folder / "stack.py").read_text() == "two"


def test_a_branch_that_was_rewritten(bare, work, cache):
    commit(work, "two")
    git("push", "-q", str(bare), "main", folder=work)
    fetch_repository(NamedRepository(str(bare), "main"), cache)
    git("reset", "-q", "--hard", "HEAD~1", folder=work)
    commit(work, "three")
    git("push", "-q", "--force", str(bare), "main", folder=work)
    found = fetch_repository(NamedRepository(str(bare), "main"), cache)
    assert (found.folder / "stack.py").read_text() == "three"


@pytest.mark.parametrize("kind", ["tag", "commit"])
def test_tags_and_commits(bare, work, cache, kind):
    head = git("rev-parse", "HEAD", folder=work)
    git("tag", "-a", "-m", "first", "v1", folder=work)
    git("push", "-q", str(bare), "v1", folder=work)
    found = fetch_repository(NamedRepository(str(bare), "v1" if kind == "tag" else head), cache)
    assert found.commit == head


def test_a_known_commit_needs_the_repository_no_more(bare, work, cache):
    head = git("rev-parse", "HEAD", folder=work)
    fetch_repository(NamedRepository(str(bare), "main"), cache)
    bare.rename(bare.with_name("gone"))
    found = fetch_repository(NamedRepository(str(bare), head, "touch made"), cache)
    assert (found.folder / "made").exists()
    with pytest.raises(UsageError, match=r"bare\.git"):
        fetch_repository(NamedRepository(str(bare), "main"), cache)


def test_the_setup_is_part_of_the_entry(bare, cache):
    plain = fetch_repository(NamedRepository(str(bare), "main"), cache)
    made = fetch_repository(
        NamedRepository(str(bare), "main", "mkdir deps && echo x > deps/y"), cache
    )
    assert made.key != plain.key
    assert (made.folder / "deps" / "y").read_text() == "x\n"
    assert not (plain.folder / "deps").exists()


def one_line(raised):
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_a_setup_that_fails(bare, cache):
    with pytest.raises(UsageError, match="no compiler") as raised:
        fetch_repository(
            NamedRepository(str(bare), "main", "mkdir -m 500 x; echo no compiler >&2; false"), cache
        )
    assert "setup 'mkdir" in one_line(raised)
    assert not leftovers(cache)
    assert list((cache / "repositories").glob("[!.]*/tree")) == []


def ended(pid):
    """Whether a process is gone, or would be if somebody waited for it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


@pytest.mark.parametrize("late", [False, True])
def test_nothing_of_a_setup_outlives_it(bare, cache, tmp_path, monkeypatch, late):
    """Neither what it leaves behind, which holds its output open, nor what comes too late."""
    setup = f"sleep 600 & echo $! > {tmp_path}/pid"
    given = NamedRepository(str(bare), "main", f"{setup}; wait" if late else setup)
    if late:
        fetch_repository(NamedRepository(str(bare), "main"), cache)  # git has its time
        for patience_s in (2, 8, 32):  # git, which begins, may be late as well
            monkeypatch.setattr(inputs, "TIMEOUT_S", float(patience_s))
            with pytest.raises(InfrastructureError, match=f"not done after {patience_s} s"):
                fetch_repository(given, cache)
            if (tmp_path / "pid").exists():
                break
    else:
        assert fetch_repository(given, cache).folder.is_dir()
    pid = int((tmp_path / "pid").read_text())
    while not ended(pid):
        pass  # the signal is on its way
    assert not leftovers(cache)


def test_a_setup_that_says_too_much_keeps_its_last_words(bare, cache, monkeypatch):
    monkeypatch.setattr(inputs, "OUTPUT_BYTES_MAX", 100)
    setup = "yes | head -c 1000000; echo the end; exit 4"
    with pytest.raises(UsageError, match=r"exit code 4: .*the end; what"):
        fetch_repository(NamedRepository(str(bare), "main", setup), cache)
    (log,) = (cache / "repositories").glob("*.log")
    assert log.stat().st_size < 300


@pytest.mark.parametrize(
    "url",
    ["https://me:secret@example.org/x.git", "https://secret@example.org/x", "ssh://a:secret@b/c"],
)
def test_passwords_do_not_get_into_logs(url):
    with pytest.raises(UsageError, match="user or password") as raised:
        NamedRepository(url, "main")
    assert "secret" not in one_line(raised)
    NamedRepository("ssh://git@example.org/x.git", "main")
    NamedRepository("git@example.org:x.git", "main")
    NamedRepository("https://example.org/a@b", "main")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"url": "/nowhere.git"}, "/nowhere.git"),
        ({"ref": "mian"}, "no branch, tag or commit 'mian'; there are main"),
        ({"ref": "0" * 40}, "no branch, tag or commit"),
    ],
)
def test_one_line_errors(bare, cache, changes, said):
    with pytest.raises(UsageError, match=said) as raised:
        fetch_repository(NamedRepository(**{"url": str(bare), "ref": "main", **changes}), cache)
    one_line(raised)
    assert not leftovers(cache)


@pytest.mark.parametrize("value", ["", "--upload-pack=touch x", "a b", "a\nb"])
def test_what_git_could_take_for_an_option(value):
    with pytest.raises(UsageError, match="leading '-'"):
        NamedRepository(value, "main")
    with pytest.raises(UsageError, match="leading '-'"):
        NamedRepository("/x.git", value)


def test_an_empty_repository(tmp_path, cache):
    git("init", "-q", "--bare", "empty.git", folder=tmp_path)
    with pytest.raises(UsageError, match="none at all"):
        fetch_repository(NamedRepository(str(tmp_path / "empty.git"), "main"), cache)


def test_without_git(bare, cache, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InfrastructureError, match="no command git"):
        fetch_repository(NamedRepository(str(bare), "main"), cache)


def test_a_cache_that_cannot_be_made(bare, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises((UsageError, InfrastructureError), match=r"cache .*file") as raised:
        fetch_repository(NamedRepository(str(bare), "main"), tmp_path / "file" / "cache")
    one_line(raised)


def test_two_at_once_run_the_setup_once(bare, cache, tmp_path):
    """Both in processes of their own; the set-up counts its runs outside of the entry."""
    setup = f"echo run >> {tmp_path}/runs"
    script = (
        "import sys; from pathlib import Path; from hpc.inputs import *; "
        "print(fetch_repository(NamedRepository(*sys.argv[1:4]), Path(sys.argv[4])).folder)"
    )
    words = [sys.executable, "-c", script, str(bare), "main", setup, str(cache)]
    children = [subprocess.Popen(words, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    folders = {child.communicate()[0] for child in children}
    assert [child.returncode for child in children] == [0] * 4
    assert len(folders) == 1
    assert (tmp_path / "runs").read_text() == "run\n"
    assert not leftovers(cache)


def test_two_at_once_without_locks(bare, cache, tmp_path, monkeypatch):
    """On a file system without locks both do the work, and both get the one entry."""

    def no_lock(*_):
        raise OSError(inputs.errno.ENOLCK, "no locks")

    monkeypatch.setattr(inputs.fcntl, "flock", no_lock)
    fetch_repository(NamedRepository(str(bare), "main"), cache)  # the mirror
    meet = tmp_path / "meet"
    os.mkfifo(meet)
    setup = f"read x < {meet}"
    found = []
    threads = [
        threading.Thread(
            target=lambda: found.append(
                fetch_repository(NamedRepository(str(bare), "main", setup), cache)
            )
        )
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    while len(leftovers(cache)) < 2:
        pass
    while any(thread.is_alive() for thread in threads):
        try:
            with open(os.open(meet, os.O_WRONLY | os.O_NONBLOCK), "w") as file:  # noqa: PTH123
                file.write("go\n")
        except OSError:
            continue  # nobody reads at this moment
    assert len(found) == 2
    assert found[0] == found[1]
    assert not leftovers(cache)


def test_a_fetch_that_was_killed_leaves_no_entry(bare, cache, tmp_path):
    script = (
        "import sys; from pathlib import Path; from hpc.inputs import *; "
        "fetch_repository(NamedRepository(*sys.argv[1:4]), Path(sys.argv[4]))"
    )
    ready = tmp_path / "ready"
    os.mkfifo(ready)
    setup = f"echo > {ready}; exec sleep 600"
    child = subprocess.Popen(
        [sys.executable, "-c", script, str(bare), "main", setup, str(cache)],
        start_new_session=True,
    )
    ready.read_text()  # the set-up is running
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    assert len(leftovers(cache)) == 1
    assert list((cache / "repositories").glob("[!.]*/tree")) == []
    # The next fetch of the same entry clears up; here with a set-up that ends.
    key = leftovers(cache)[0].split(".")[1]
    with inputs._locked(cache / "repositories" / f"{key}.lock") as alone:
        assert alone
        with inputs._scratch(cache / "repositories", key, alone):
            assert len(leftovers(cache)) == 1
    assert not leftovers(cache)


# --- images -------------------------------------------------------------------------------------


def test_an_image_file_is_kept_by_its_content(tmp_path, cache):
    image = tmp_path / "mine.sif"
    image.write_bytes(b"SIF" * 1000)
    found = fetch_image(str(image), cache)
    assert found.name == hashlib.sha256(image.read_bytes()).hexdigest() + ".sif"
    assert found.stat().st_mode & 0o777 == 0o444
    image.write_bytes(b"another")
    assert found.read_bytes() == b"SIF" * 1000
    assert fetch_image(str(image), cache) != found
    assert not leftovers(cache)


def test_no_such_image(cache):
    with pytest.raises(UsageError, match="docker://NAME"):
        fetch_image("python:3.12", cache)
    assert not leftovers(cache)


@pytest.fixture
def puller(tmp_path, monkeypatch):
    """An ``apptainer`` that writes an image and counts its calls."""
    folder = tmp_path / "bin"
    folder.mkdir()
    tool = folder / "apptainer"
    tool.write_text(
        f'#!/bin/sh\necho "$@" >> {tmp_path}/calls\n'
        f'[ "$3" != docker://bad ] || {{ echo "manifest unknown" >&2; exit 255; }}\n'
        f'wc -l < {tmp_path}/calls > "$2"\n'
    )
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return tmp_path / "calls"


def test_a_reference_is_pulled_once_unless_asked_again(cache, puller):
    first = fetch_image("docker://a/b:1", cache)
    assert fetch_image("docker://a/b:1", cache) == first
    assert puller.read_text() == "pull image.sif docker://a/b:1\n"
    assert fetch_image("docker://a/b:1", cache, refresh=True) != first
    assert first.exists()


def test_a_pull_that_fails_is_one_line(cache, puller):
    with pytest.raises(UsageError, match="image docker://bad: manifest unknown"):
        fetch_image("docker://bad", cache)
    assert not leftovers(cache)


def test_without_apptainer(cache, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InfrastructureError, match="no command apptainer"):
        fetch_image("docker://a/b:1", cache)
    assert not list(Path(cache, "images").glob("*.sif"))


# --- the commands -------------------------------------------------------------------------------


def hpc(*words, folder):
    """Run the command in ``folder``."""
    return subprocess.run(
        [sys.executable, "-m", "hpc", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_commands_print_where_it_is(bare, tmp_path):
    done = hpc("fetch", "repository", str(bare), "--setup", "touch made", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert Path(done.stdout.strip(), "made").exists()
    (tmp_path / "mine.sif").write_text("SIF")
    done = hpc("fetch", "image", "mine.sif", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert Path(done.stdout.strip()).read_text() == "SIF"


def test_the_commands_fail_in_one_line(bare, tmp_path):
    done = hpc("fetch", "repository", str(bare), "--ref", "no", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "no branch, tag or commit 'no'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_what_a_setup_left_without_rights_is_removed():
    """By who is not root: root may do anything anyway."""
    outside = Path(tempfile.mkdtemp())
    try:
        left = outside / "left"
        (left / "a" / "b").mkdir(parents=True)
        (left / "a" / "b" / "file").write_text("x")
        (outside / "kept").mkdir(mode=0o500)
        (left / "link").symlink_to(outside / "kept")
        nobody = 65534 if os.geteuid() == 0 else os.geteuid()
        for path in (outside, *outside.rglob("*")):
            os.chown(path, nobody, -1, follow_symlinks=False)
        for path in (left / "a" / "b", left / "a", left):
            path.chmod(0)
        before = os.geteuid()
        os.seteuid(nobody)
        try:
            inputs._remove(left)
        finally:
            os.seteuid(before)
        assert not left.exists()
        assert (outside / "kept").stat().st_mode & 0o777 == 0o500
    finally:
        inputs._remove(outside)
