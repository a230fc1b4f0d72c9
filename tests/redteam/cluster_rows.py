"""Attacks by clusters, and by files that say which clusters there are."""

from __future__ import annotations

import itertools
import os
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import yaml
from attacks import Found, attack
from input_rows import all_refused
from parser_theft import READS_S
from theatre import NOBODY, Theatre

BELL = r"\033[2J\033]0;root\007"
"""What a terminal would obey, as ``printf`` takes it."""


def told(theatre: Theatre, words: tuple[str, ...], codes: tuple[int, ...], path: str = "") -> str:
    """What is wrong with how ``hpc WORDS`` refuses; empty: nothing."""
    prefix = ("env", f"PATH={path}:{os.environ['PATH']}") if path else ()
    child = theatre.marked.start("hpc", *words, prefix=prefix, folder=theatre.folder)
    try:
        out, err = child.communicate(timeout=READS_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return "hangs"
    if child.returncode not in codes:
        return f"exit code {child.returncode}"
    lines = (out + err).splitlines()
    return "" if len(lines) == 1 and lines[0].isprintable() else "more than one printable line"


@attack(15, "a sites file with options, shell and links", "who sends a sites file", "files")
def sites_that_run(theatre: Theatre) -> Found:
    """Nothing of it is run; each is one line."""
    ran = theatre.folder / "ran"
    shell = f"/x$(touch {ran})`touch {ran}`;touch {ran}"
    places = {"folder": "/home/me", "bin": "/opt/bin"}
    entries = {
        "an option as login": {"ssh": f"-oProxyCommand=touch {ran}", **places},
        "a login with a line break": {"ssh": f"me@host\ntouch {ran}", **places},
        "an endpoint with shell": {"connect": f"tls/$(touch {ran}):1"},
        "a partition with shell": {"partition": f"$(touch {ran})"},
        "a scratch with shell": {"scratch": f"/tmp/$(touch {ran})"},
        "a module with shell": {"modules": [f"a;touch {ran}"]},
        "a directive with a line": {"directives": [f"--x\ntouch {ran}"]},
        "an unknown scheduler": {"scheduler": shell},
    }
    words = ("submit", "aeb-demo", "--time", "01:00", "--workers", "1", "--on", "slurm:north")
    found = {}
    for number, (name, entry) in enumerate(entries.items()):
        data = {"sites": {"north": {"scheduler": "slurm", "bin": "/opt/bin", **entry}}}
        path = theatre.write(f"sites{number}.yaml", yaml.safe_dump(data))
        path.chmod(0o600)
        found[name] = told(theatre, (*words, "--sites", str(path)), (2,))
    link = theatre.folder / "zero.yaml"
    link.symlink_to("/dev/zero")
    found["/dev/zero"] = told(theatre, (*words, "--sites", str(link)), (2,))
    pairs = itertools.pairwise("abcdefghijklmnopqrstuvwxyz")
    bomb = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in pairs)
    path = theatre.write("bomb.yaml", bomb)
    path.chmod(0o600)
    found["a bomb of aliases"] = told(theatre, (*words, "--sites", str(path)), (2,))
    if ran.exists():
        return Found("open", "a command of it was run")
    return all_refused(found, "words are checked, quoted and told in one line")


@attack(15, "writes the victim's sites file", "another local user", "files", root=True)
def sites_of_somebody_else(theatre: Theatre) -> Found:
    """A file that somebody else may write is not believed."""
    ran = theatre.folder / "ran"
    reach = ["sh", "-c", f"touch {ran}"]
    entry = {"scheduler": "slurm", "reach": reach, "folder": "/f", "bin": "/b", "workers": 1}
    text = yaml.safe_dump({"sites": {"north": entry}})
    words = ("submit", "aeb-demo", "--time", "01:00", "--on", "slurm:north", "--sites")
    found = {}
    for name, mode, owner in (("theirs", 0o600, NOBODY), ("for all", 0o666, os.geteuid())):
        path = theatre.write(f"{name}.yaml", text)
        path.chmod(mode)
        os.chown(path, owner, owner)
        found[name] = told(theatre, (*words, str(path)), (2,))
    if ran.exists():
        return Found("open", "its command was run")
    return all_refused(found, "only a file of its own user that nobody else may write")


@attack(15, "answers of a batch system without end, or for the terminal", "a cluster", "its login")
def answers_of_a_batch_system(theatre: Theatre) -> Found:
    """One line, whatever ``scontrol`` and ``qstat`` say, and how much."""
    programs = {
        "endless": "exec yes aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
        "endless errors": "exec yes aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa >&2",
        "escapes": f"printf 'JobState={BELL} Reason={BELL}\\n    job_state = {BELL}\\n'",
        "escapes in errors": f"printf 'x: error: {BELL}\\n' >&2; exit 1",
        "numbers": f"printf 'JobState=FAILED Restarts={'9' * 5000} ExitCode={'9' * 5000}:1'",
    }
    found = {}
    for name, program in programs.items():
        folder = theatre.folder / name.replace(" ", "-")
        folder.mkdir()
        for tool in ("scontrol", "qstat"):
            (folder / tool).write_text(f"#!/bin/sh\n{program}\n")
            (folder / tool).chmod(0o755)
        for which in ("slurm", "pbs"):
            words = ("status", "12", "--scheduler", which)
            found[f"{name} of {which}"] = told(theatre, words, (0, 2, 3), str(folder))
    return all_refused(found, "bounded in bytes and time, escaped, one line")


class _Endless(BaseHTTPRequestHandler):
    """Answers by the run's name."""

    protocol_version = "HTTP/1.1"

    def log_message(self, *_: object) -> None:
        """Quiet."""

    def do_GET(self) -> None:
        """An answer without end, of the wrong type, or for a terminal."""
        tower = b"[" * 200_000
        words = b'{"message": "\\u001b[2J\\nroot"}'
        bodies = {"tower": tower, "words": words}
        body = next((bodies[name] for name in bodies if name in self.path), b"x" * (1 << 20))
        self.send_response(403 if "words" in self.path else 200)
        self.send_header("Content-Type", "application/json")
        times = 1 << 14 if "endless" in self.path else 1
        self.send_header("Content-Length", str(times * len(body)))
        self.end_headers()
        try:
            for _ in range(times):
                self.wfile.write(body)
        except OSError:
            self.close_connection = True


@attack(15, "answers of an API server without end, towers, or for the terminal", "a cluster", "API")
def answers_of_an_api(theatre: Theatre) -> Found:
    """One line, whatever the server of a kubeconfig answers."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Endless)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    content = {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "c",
        "clusters": [
            {"name": "c", "cluster": {"server": f"http://127.0.0.1:{server.server_port}"}}
        ],
        "users": [{"name": "c", "user": {"token": "t"}}],
        "contexts": [{"name": "c", "context": {"cluster": "c", "user": "c"}}],
    }
    config = theatre.write("kubeconfig", yaml.safe_dump(content))
    before = os.environ.get("KUBECONFIG")
    os.environ["KUBECONFIG"] = str(config)
    try:
        found = {
            name: told(theatre, ("status", f"robots/dt-{name}@c"), (2, 3))
            for name in ("endless", "tower", "words", "garbage")
        }
    finally:
        if before is None:
            del os.environ["KUBECONFIG"]
        else:
            os.environ["KUBECONFIG"] = before
        server.shutdown()
        server.server_close()
        thread.join()
    return all_refused(found, "bounded in bytes, escaped, one line")
