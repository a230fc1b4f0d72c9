from hpc import script
from hpc.commands import call
from hpc.scheduler import JobStatus, Partition, Partitions
from twin.base.errors import UsageError


class Hut:
    name = "hut"

    def render(self, request):
        head = f"#!/bin/bash\n#HUT {script.job_name(request.campaign)}"
        return "\n\n".join((head, script.names(request), "sleep 1\n"))

    def render_array(self, request, cases, /):
        raise UsageError("--array: not in a hut")

    def check(self, text, request, /):
        done = call("hutsub", "--dry-run", request.partition or "ground", text=text)
        if done.code:
            raise UsageError(f"Hut refuses this job: {done.last_words}")

    def submit(self, path, folder):
        return call("hutsub", str(path), folder=folder).out.strip()

    def status(self, job):
        return JobStatus("pending", "KNOCKING", reason="nobody opens")

    def cancel(self, job):
        call("hutsub", "--cancel", job)

    def requeue(self, job):
        self.cancel(job)

    def signal(self, job, name):
        raise UsageError("a hut hears no signals")

    def interactive(self, request, command):
        return ["hutsub", "--shell", *command]

    def log(self, job, request, /):
        return f"{job}.log"

    def partitions(self, wait_s):
        return Partitions((Partition("ground", state="up"),))
