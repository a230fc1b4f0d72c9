"""What makes the objects of :mod:`kube_api` work: Jobs, a scheduler, and kubelets whose containers
are real processes.

A container is a command in a sandbox of bubblewrap: the image is this machine's system, our
environment at ``/opt/drivetwin`` and nothing else, its root is read-only, it runs as its pod's
user without capabilities, is process 1 of its own, and sees its volumes where the pod mounts them.

What is not as in a cluster: all pods share one network (a Service's name is a line of
``/etc/hosts``, network policies are not enforced), and resources and seccomp are not limited.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from kube_api import Api, Object, RefusalError, Store, conditions

ROOT = Path(__file__).resolve().parents[2]
TICK_S = 0.02
IMAGE = "registry.example/drivetwin:1"
"""The only image there is."""
TERMINAL = ("Succeeded", "Failed")


def send(pid: int, number: signal.Signals) -> bool:
    """Send a signal to a process, and to no group of processes; False: there is none."""
    if pid <= 0:
        return False
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return False
    return True


def missing() -> str:
    """Why this machine cannot run pods; empty: it can."""
    for program in ("bwrap", "setpriv"):
        if shutil.which(program) is None:
            return f"no {program} here"
    return "" if os.geteuid() == 0 else "containers are other users, so this needs root"


@dataclass
class RunningPod:
    """Processes of a pod."""

    folder: Path
    container: subprocess.Popen[bytes] | None = None
    pid: int = 0
    """Process 1 of the running container, as the host sees it."""
    killed_by_node: bool = False
    deadline_s: float = field(default=float("inf"))


class KubeCluster:
    """Nodes, controllers and the API; ``with`` starts and ends it."""

    def __init__(self, nodes: tuple[str, ...] = ("n1", "n2"), variables: Object | None = None):
        self.folder = Path(tempfile.mkdtemp(prefix="kube-"))
        self.folder.chmod(0o755)
        for name in ("conductor", "twin"):
            program = self.folder / "image" / "bin" / name
            program.parent.mkdir(parents=True, exist_ok=True)
            program.write_text(f'#!/bin/sh\nexec {sys.executable} -m {name} "$@"\n')
            program.chmod(0o755)
        self.nodes = dict.fromkeys(nodes, True)
        """Whether a node takes pods."""
        self.variables = variables or {}
        """Environment of the image."""
        self.prefix: tuple[str, ...] = ()
        """Words before each container, into another network."""
        self.image_folders: dict[str, Path] = {}
        """Further folders of the image, by their place in it."""
        self.store = Store()
        self.api = Api(self.store)
        self.api.delete, self.api.evict = self.delete, self.evict
        self.api.delete_namespace, self.api.log = self.delete_namespace, self.log
        self.api.run_in, self.api.nodes = self.run_in, self._node_list
        self.running: dict[str, RunningPod] = {}
        """Pods by uid."""
        self.counted: set[str] = set()
        """Uids of ended pods that their Job has counted, or need not count."""
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._next_node = 0
        self.failure: BaseException | None = None

    def __enter__(self) -> KubeCluster:
        for work in (self.api.serve_forever, self._control):
            thread = threading.Thread(target=work, daemon=True)
            thread.start()
            self._threads.append(thread)
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.api.shutdown()
        self.api.server_close()
        for pod in [*self.running.values()]:
            self._kill(pod)
        for thread in [*self._threads]:
            thread.join()
        shutil.rmtree(self.folder, ignore_errors=True)
        if self.failure is not None:
            raise self.failure

    # --- what tests do to it ----------------------------------------------------------------

    def pods(self, component: str, *phases: str) -> list[Object]:
        """Pods of a component that have one of the phases and are not about to go."""
        with self.store.lock:
            return [
                pod
                for pod in self.store.list("pods")
                if pod["metadata"]["labels"].get("app.kubernetes.io/component") == component
                and (not phases or pod["status"].get("phase") in phases)
                and "deletionTimestamp" not in pod["metadata"]
            ]

    def live(self) -> list[Object]:
        """Pods that have not ended, or are about to be made."""
        with self.store.lock:
            jobs = self.store.list("jobs")
            left = [job for job in jobs if not {"Complete", "Failed"} & set(conditions(job))]
            pods = self.store.list("pods")
            return [*left, *(p for p in pods if p["status"].get("phase") not in TERMINAL)]

    def lose(self, node: str) -> int:
        """A node loses its power; the cluster notices, and removes it and its pods. How many of
        them had not ended."""
        with self.store.lock:
            self.nodes[node] = False
            there = [p for p in self.store.list("pods") if p["spec"].get("nodeName") == node]
            lost = [pod for pod in there if pod["status"].get("phase") not in TERMINAL]
            for pod in lost:
                if running := self.running.get(pod["metadata"]["uid"]):
                    running.killed_by_node = True
                    self._kill(running)
                self._disrupt(pod, "DeletionByPodGC")
                pod["metadata"].setdefault("deletionTimestamp", _now())
                pod["status"].pop("containerStatuses", None)
                pod["status"]["phase"] = "Failed"
                self.store.put("pods", pod)
            return len(lost)

    def evict(self, namespace: str, name: str) -> None:
        """As before work on a node: SIGTERM, and it counts as a disruption."""
        with self.store.lock:
            self._disrupt(self.store.read("pods", namespace, name), "EvictionByEvictionAPI")
        self.delete("pods", namespace, name)

    def delete(self, plural: str, namespace: str, name: str) -> None:
        """Delete an object and what it made; pods go when their processes have."""
        with self.store.lock:
            found = self.store.read(plural, namespace, name)
            if plural == "pods":
                self._terminate(found)
                return
            self.store.put(plural, found, "DELETED")
            if plural == "jobs":
                for pod in self._pods_of(found):
                    self.counted.add(pod["metadata"]["uid"])
                    self._terminate(pod)

    def delete_namespace(self, namespace: str) -> None:
        """Everything in it goes, and nothing comes any more."""
        with self.store.lock:
            self.store.namespaces.discard(namespace)
            places = [key for key in self.store.objects if key[1] == namespace]
        for plural, _, name in sorted(places):
            with contextlib.suppress(RefusalError):
                self.delete(plural, namespace, name)

    def log(self, namespace: str, name: str) -> bytes:
        """What a pod's containers have said."""
        with self.store.lock:
            pod = self.store.read("pods", namespace, name)
        path = self._log_path(pod)
        return path.read_bytes() if path.exists() else b""

    def logs(self) -> bytes:
        """What all pods have said that ever were."""
        return b"".join(path.read_bytes() for path in sorted(self.folder.glob("logs/*")))

    def run_in(self, namespace: str, name: str, container: str, command: list[str]) -> list[str]:
        """Words that run a command where a container runs."""
        with self.store.lock:
            pod = self.store.read("pods", namespace, name)
            running = self.running.get(pod["metadata"]["uid"])
        pid = running.pid if running is not None else 0
        if not pid:
            raise RefusalError(400, "BadRequest", f"container {container} is not running")
        inside = ["nsenter", f"--target={pid}", "--mount", "--pid", "--root", "--wd=/"]
        return [*inside, "setpriv", *_ids(pod), "--", *command]

    def claim(self, name: str) -> Path:
        """The storage of a claim."""
        return self.folder / "claims" / name

    # --- controllers ------------------------------------------------------------------------

    def _control(self) -> None:
        try:
            while not self._over.wait(TICK_S):
                with self.store.lock:
                    for job in self.store.list("jobs"):
                        self._work_on(job)
                    for pod in self.store.list("pods"):
                        self._look_after(pod)
        except BaseException as error:
            self.failure = error
            raise

    def _work_on(self, job: Object) -> None:
        spec, status = job["spec"], job["status"]
        if {"Complete", "Failed"} & set(conditions(job)):
            return
        before = json.dumps(status, sort_keys=True)
        pods = self._pods_of(job)
        for pod in pods:
            if pod["status"].get("phase") in TERMINAL:
                self._count(job, pod)
        active = [pod for pod in pods if pod["status"].get("phase") not in TERMINAL]
        staying = [pod for pod in active if "deletionTimestamp" not in pod["metadata"]]
        succeeded, failed = status.get("succeeded", 0), status.get("failed", 0)
        completions = spec.get("completions")
        wanted = spec["parallelism"]
        if completions is not None:
            wanted = min(wanted, completions - succeeded)
        elif succeeded:
            wanted = len(staying)  # a work queue that one pod has found empty
        if spec.get("suspend"):
            wanted = 0
        if "Failed" not in status.get("ending", ""):
            if failed > spec["backoffLimit"]:
                status["ending"] = "Failed BackoffLimitExceeded"
            elif succeeded >= (completions or 1) and (completions or not active):
                status["ending"] = "Complete"
        if status.get("ending"):
            wanted = 0
            if not active:
                self._end(job)
                return
        for pod in staying[wanted:]:
            self.counted.add(pod["metadata"]["uid"])
            self._terminate(pod)
        # As with a podFailurePolicy: a pod that is about to go is replaced when it has gone.
        for _ in range(wanted - len(active)):
            if not self._make_pod(job):
                break
        status["active"] = len(active)
        if json.dumps(status, sort_keys=True) != before:
            self.store.put("jobs", job)

    def _end(self, job: Object) -> None:
        kind, _, reason = job["status"].pop("ending").partition(" ")
        condition = {"type": kind, "status": "True", "reason": reason}
        job["status"].setdefault("conditions", []).append(condition)
        job["status"]["active"] = 0
        self.store.put("jobs", job)

    def _count(self, job: Object, pod: Object) -> None:
        uid = pod["metadata"]["uid"]
        if uid in self.counted:
            return
        self.counted.add(uid)
        status = job["status"]
        if pod["status"]["phase"] == "Succeeded":
            status["succeeded"] = status.get("succeeded", 0) + 1
            return
        action = _action(job["spec"].get("podFailurePolicy", {}).get("rules", ()), pod)
        if action == "FailJob":
            status["ending"] = "Failed PodFailurePolicy"
        if action != "Ignore":
            status["failed"] = status.get("failed", 0) + 1

    def _make_pod(self, job: Object) -> bool:
        name, namespace = job["metadata"]["name"], job["metadata"]["namespace"]
        template = job["spec"]["template"]
        labels = {**template["metadata"]["labels"], "batch.kubernetes.io/job-name": name}
        pod = {
            "apiVersion": "v1",
            "kind": "Pod",
            "metadata": {"name": f"{name}-{uuid.uuid4().hex[:5]}", "labels": labels},
            "spec": template["spec"],
        }
        try:
            self.store.create("pods", namespace, pod, dry_run=False)
        except RefusalError as refusal:
            known = [e["involvedObject"]["name"] for e in self.store.list("events", namespace)]
            if name not in known:
                message = f"Error creating: {refusal.message}"
                self.store.event(namespace, name, "FailedCreate", message)
            return False
        return True

    def _pods_of(self, job: Object) -> list[Object]:
        label = f"batch.kubernetes.io/job-name={job['metadata']['name']}"
        return self.store.list("pods", job["metadata"]["namespace"], label)

    def _disrupt(self, pod: Object, reason: str) -> None:
        condition = {"type": "DisruptionTarget", "status": "True", "reason": reason}
        pod["status"].setdefault("conditions", []).append(condition)

    # --- scheduler and kubelets -------------------------------------------------------------

    def _look_after(self, pod: Object) -> None:
        meta, status = pod["metadata"], pod["status"]
        running = self.running.get(meta["uid"])
        if status.get("phase") in TERMINAL or (running is None and "deletionTimestamp" in meta):
            # Its Job has seen it, in the same turn, if it has one.
            if "deletionTimestamp" in meta:
                self.store.put("pods", pod, "DELETED")
            return
        if running is None:
            self._place(pod)
        elif running.container is not None and time.monotonic() > running.deadline_s:
            self._kill(running)

    def _place(self, pod: Object) -> None:
        status = pod["status"]
        up = [name for name, takes in self.nodes.items() if takes]
        if pod["spec"].get("nodeSelector"):
            up = []  # nodes here have no labels
        held = {
            volume.get("persistentVolumeClaim", {}).get("claimName") for volume in _volumes(pod)
        }
        for other in self.store.list("pods"):
            theirs = {v.get("persistentVolumeClaim", {}).get("claimName") for v in _volumes(other)}
            if (held & theirs) - {None} and other["metadata"]["uid"] in self.running:
                up = [name for name in up if name == other["spec"]["nodeName"]]
        if not up:
            message = f"0/{len(self.nodes)} nodes are available"
            condition = {"type": "PodScheduled", "status": "False", "reason": "Unschedulable"}
            if status.get("phase") != "Pending":
                status |= {"phase": "Pending", "conditions": [condition | {"message": message}]}
                self.store.put("pods", pod)
            return
        if pod["spec"]["containers"][0]["image"] != IMAGE:
            if status.get("phase") != "Pending":
                waiting = {"reason": "ImagePullBackOff", "message": "Back-off pulling image"}
                bad = {"name": "key", "state": {"waiting": waiting}, **_NO_STATUS}
                status |= {"phase": "Pending", "initContainerStatuses": [bad]}
                self.store.put("pods", pod)
            return
        pod["spec"] = {**pod["spec"], "nodeName": up[self._next_node % len(up)]}
        self._next_node += 1
        uid = pod["metadata"]["uid"]
        self.running[uid] = RunningPod(self.folder / "pods" / uid)
        status["phase"] = "Pending"
        self.store.put("pods", pod)
        thread = threading.Thread(target=self._run, args=(pod, self.running[uid]), daemon=True)
        thread.start()
        self._threads.append(thread)

    def _run(self, pod: Object, running: RunningPod) -> None:
        code = 1
        try:
            mounts = self._make_volumes(pod, running.folder)
            for container in (*pod["spec"].get("initContainers", ()), *pod["spec"]["containers"]):
                code = self._run_container(pod, running, container, mounts)
                if code:
                    break
        except RefusalError:
            pass  # its secret has gone with its namespace: it does not start
        except BaseException as error:
            self.failure = error
            raise
        finally:
            with self.store.lock:
                self.running.pop(pod["metadata"]["uid"], None)
                if not running.killed_by_node:
                    name = pod["spec"]["containers"][0]["name"]
                    ended = {"name": name, "state": {"terminated": {"exitCode": code}}}
                    pod["status"]["containerStatuses"] = [ended | _NO_STATUS]
                    pod["status"]["phase"] = "Failed" if code else "Succeeded"
                    self.store.put("pods", pod)
            shutil.rmtree(running.folder, ignore_errors=True)

    def _run_container(
        self, pod: Object, running: RunningPod, container: Object, mounts: dict[str, Path]
    ) -> int:
        read, write = os.pipe()
        words = self._words(pod, container, mounts, running.folder, write)
        path = self._log_path(pod)
        path.parent.mkdir(exist_ok=True)
        with path.open("ab") as log:
            with self.store.lock:
                if "deletionTimestamp" in pod["metadata"] or running.killed_by_node:
                    os.close(read)
                    os.close(write)
                    return 137
                child = subprocess.Popen(
                    words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, pass_fds=(write,)
                )
                os.close(write)
                running.container = child
            with os.fdopen(read) as told:
                said = told.read()
            running.pid = int(json.loads(said)["child-pid"]) if said else 0
            with self.store.lock:
                if container in pod["spec"]["containers"] and not running.killed_by_node:
                    pod["status"]["phase"] = "Running"
                    self.store.put("pods", pod)
                if "deletionTimestamp" in pod["metadata"]:
                    self._signal(running)
            code = child.wait()
        running.container, running.pid = None, 0
        return code

    def _words(
        self, pod: Object, container: Object, mounts: dict[str, Path], folder: Path, info: int
    ) -> list[str]:
        words = [
            *self.prefix,
            "bwrap",
            "--die-with-parent",
            "--unshare-pid",
            "--unshare-ipc",
            "--unshare-uts",
        ]
        words += ["--as-pid-1", "--info-fd", str(info), "--new-session", "--clearenv"]
        words += ["--hostname", pod["spec"].get("hostname", pod["metadata"]["name"])]
        words += ["--dev", "/dev", "--proc", "/proc", "--ro-bind", "/usr", "/usr"]
        for name in ("bin", "sbin", "lib", "lib64"):
            path = Path("/") / name
            if path.is_symlink():
                words += ["--symlink", str(path.readlink()), str(path)]
            elif path.exists():
                words += ["--ro-bind", str(path), str(path)]
        words += ["--ro-bind", "/etc", "/etc", "--ro-bind", str(folder / "hosts"), "/etc/hosts"]
        words += [
            *_way("/opt/drivetwin"),
            "--ro-bind",
            str(self.folder / "image"),
            "/opt/drivetwin",
        ]
        for mount in container["volumeMounts"]:
            how = "--ro-bind" if mount.get("readOnly") else "--bind"
            words += [how, str(mounts[mount["name"]]), mount["mountPath"]]
        for path in dict.fromkeys((sys.base_prefix, sys.prefix, str(ROOT))):
            words += [*_way(path), "--ro-bind", path, path]
        for place, path in self.image_folders.items():
            words += ["--bind", str(path), place]
        words += ["--remount-ro", "/", "--chdir", "/"]
        own = dict(self.variables)
        own |= {entry["name"]: entry["value"] for entry in container.get("env", ())}
        own.setdefault("PATH", "/opt/drivetwin/bin:/usr/bin:/bin")
        for name, value in own.items():
            words += ["--setenv", name, value]
        return [*words, "setpriv", *_ids(pod), "--", *container["command"]]

    def _make_volumes(self, pod: Object, folder: Path) -> dict[str, Path]:
        """Volumes as a kubelet prepares them: of root, and of the pod's group."""
        group = pod["spec"]["securityContext"]["fsGroup"]
        made = {}
        folder.mkdir(parents=True)
        with self.store.lock:
            namespace = pod["metadata"]["namespace"]
            services = [found["metadata"]["name"] for found in self.store.list("services")]
            hosts = "".join(f"127.0.0.1 {name}\n" for name in ("localhost", *services))
            (folder / "hosts").write_text(hosts)
            for volume in _volumes(pod):
                path = folder / volume["name"]
                if "persistentVolumeClaim" in volume:
                    path = self.claim(volume["persistentVolumeClaim"]["claimName"])
                path.mkdir(parents=True, exist_ok=True)
                if "secret" in volume:
                    found = self.store.read("secrets", namespace, volume["secret"]["secretName"])
                    for name, data in found["data"].items():
                        (path / name).write_bytes(_decoded(data))
                        os.chown(path / name, 0, group)
                        (path / name).chmod(volume["secret"]["defaultMode"])
                if "configMap" in volume:
                    found = self.store.read("configmaps", namespace, volume["configMap"]["name"])
                    for name, text in found["data"].items():
                        (path / name).write_text(text)
                os.chown(path, 0, group)
                path.chmod(0o2775)
                made[volume["name"]] = path
        return made

    def _terminate(self, pod: Object) -> None:
        if "deletionTimestamp" in pod["metadata"] or pod["status"].get("phase") in TERMINAL:
            pod["metadata"].setdefault("deletionTimestamp", _now())
            return
        pod["metadata"]["deletionTimestamp"] = _now()
        self.store.put("pods", pod)
        if running := self.running.get(pod["metadata"]["uid"]):
            grace_s = pod["spec"]["terminationGracePeriodSeconds"]
            running.deadline_s = time.monotonic() + grace_s
            self._signal(running)

    def _signal(self, running: RunningPod) -> None:
        send(running.pid, signal.SIGTERM)

    def _kill(self, running: RunningPod) -> None:
        # Its own thread clears both when the container has ended.
        container, pid = running.container, running.pid
        if container is not None:
            container.kill()
        send(pid, signal.SIGKILL)

    def _log_path(self, pod: Object) -> Path:
        return self.folder / "logs" / pod["metadata"]["name"]

    def _node_list(self) -> list[Object]:
        return [
            {
                "metadata": {"name": name},
                "spec": {},
                "status": {
                    "allocatable": {"cpu": "8", "memory": "32Gi", "nvidia.com/gpu": "2"},
                    "conditions": [{"type": "Ready", "status": str(takes)}],
                },
            }
            for name, takes in self.nodes.items()
        ]


_NO_STATUS = {"image": "", "imageID": "", "ready": False, "restartCount": 0}


def _action(rules: Any, pod: Object) -> str:
    """The first rule of a podFailurePolicy that fits a pod that failed."""
    held = set(conditions(pod))
    codes = {
        found["name"]: found["state"]["terminated"]["exitCode"]
        for found in pod["status"].get("containerStatuses", ())
    }
    for rule in rules:
        if any(wanted["type"] in held for wanted in rule.get("onPodConditions", ())):
            return str(rule["action"])
        if wanted := rule.get("onExitCodes"):
            assert wanted["operator"] == "In"
            if codes.get(wanted["containerName"]) in wanted["values"]:
                return str(rule["action"])
    return "Count"


def _ids(pod: Object) -> list[str]:
    context = pod["spec"]["securityContext"]
    user, group = context["runAsUser"], context["runAsGroup"]
    kept = f"--groups={context['fsGroup']}"
    return [
        *(f"--reuid={user}", f"--regid={group}", kept),
        *("--inh-caps=-all", "--bounding-set=-all", "--no-new-privs"),
    ]


def _way(path: str) -> list[str]:
    """Words that make the folders above a path; those that bubblewrap makes by itself are root's
    alone."""
    parents = [*Path(path).parents][-2::-1]
    return [word for parent in parents for word in ("--perms", "0755", "--dir", str(parent))]


def _volumes(pod: Object) -> list[Object]:
    return list(pod["spec"].get("volumes", ()))


def _decoded(data: str) -> bytes:
    import base64

    return base64.b64decode(data)


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
