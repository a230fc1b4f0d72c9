from schemas.kinds.batch_system import BatchSystemKind

HUT = BatchSystemKind(
    name="hut",
    title="Hut",
    implementation="plugin_example.hut:Hut",
    submits="hutsub",
    version=("hutsub", "--version"),
    opens="hutsub --shell",
    constraint="a floor",
    job_variable="HUT_JOB",
    job_ids="hut-[0-9]+",
)
