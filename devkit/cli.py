"""The ``devkit`` command."""

from __future__ import annotations

import twin.base.start  # noqa: F401 - before anything that takes long to load

# isort: split
import os
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
import typer

from devkit.checking.command import check, parsed_parameters
from devkit.detector.commands import (
    check_models,
    darknet_cfg,
    detect,
    import_darknet,
    models,
    parity,
)
from devkit.detector.integer.command import quantize
from devkit.replaying.command import replay
from devkit.training.commands import evaluate, train
from twin.base.cli import make_app
from twin.base.command import run
from twin.base.errors import UsageError
from twin.base.process import PARENT_VARIABLE, bind_to_parent, watch_lifeline
from twin.fabric.endpoint import LATER
from twin.sandbox.inside import limit_self
from twin.sandbox.view import decode

app = make_app("devkit", "What an autonomy engineer touches: `devkit host` runs a stack.")
app.command("import-darknet")(import_darknet)
app.command("darknet-cfg")(darknet_cfg)
app.command("models")(models)
app.command("check-models")(check_models)
app.command("detect")(detect)
app.command("quantize")(quantize)
app.command("train")(train)
app.command("evaluate")(evaluate)
app.command("parity")(parity)
app.command("check")(check)
app.command("replay")(replay)


@app.command(hidden=True)
def kernels(
    device: Annotated[str, typer.Option(help="Where networks will compute, cpu or cuda:N.")],
    into: Annotated[Path, typer.Option(help="Folder to make.")],
) -> None:
    """Compile the kernels of the shipped networks, as workers do for stacks in sandboxes."""
    from devkit.detector.compiling import compile_kernels

    if os.environ.get(PARENT_VARIABLE):
        bind_to_parent()
        watch_lifeline()
    compile_kernels(device, into)


@app.command("check-bridge", hidden=True)
def check_bridge(
    bridge: Annotated[str, typer.Argument(help="Name of the bridge.")],
    parameters: Annotated[str, typer.Argument(help="Its parameters as JSON.")],
) -> None:
    """Print JSON, parameter -> one line that says why it is not allowed; `conductor` asks this
    before it leases a case. Nothing is started."""
    import json

    from devkit.bridges import parameter_mistakes

    print(json.dumps(parameter_mistakes(bridge, parsed_parameters(parameters))))


RigKey = Annotated[
    Path | None, typer.Option(help="The key that the rig gave its stack, for tls/ endpoints.")
]
Join = Annotated[
    Path | None,
    typer.Option(
        help="Serve every rig that you announce in this shared folder, which holds their keys, "
        "too; nobody else may write there."
    ),
]
Commands = Annotated[
    bool,
    typer.Option(
        "--commands",
        help="With --join: start the commands, bridges and containers that campaigns name.",
    ),
]
T = TypeVar("T")


@app.command()
def host(
    context: typer.Context,
    connect: Annotated[str, typer.Option(help="Endpoint of the simulator.")] = "",
    rig: Annotated[str, typer.Option(help="Rig to join.")] = "",
    namespace: Annotated[str, typer.Option(help="Namespace of the rig.")] = "twin",
    slots: Annotated[int, typer.Option(min=1, help="Slots of the rig.")] = 1,
    stack: Annotated[str, typer.Option(help="Stack under test, module:Class.")] = "",
    parameters: Annotated[str, typer.Option(help="Stack parameters as JSON.")] = "{}",
    foreign: Annotated[
        str, typer.Option(help="Command of a stack in a process of its own, as JSON.")
    ] = "",
    expected: Annotated[
        str, typer.Option(help="What its cases will look with, as JSON; loaded beforehand.")
    ] = "[]",
    source: Annotated[
        str, typer.Option(help="What the stack consisted of at submission, as JSON.", hidden=True)
    ] = "{}",
    # No TWIN_KEY: that names keys of the conductor's fabric, none of which opens a rig.
    key: RigKey = None,
    join: Join = None,
    commands: Commands = False,
    sandbox: Annotated[
        str, typer.Option(help="What is seen of the machine, as JSON.", hidden=True)
    ] = "",
    load_for: Annotated[str, typer.Option("--load-for", hidden=True)] = "cpu",
) -> None:
    """Run a stack on the bus: for one rig, or with --join for rigs of other nodes."""
    limit_self()
    if connect == LATER:
        from devkit.hosting.preload import await_arguments

        arguments = await_arguments(load_for)
        with context.command.make_context("host", arguments, context.parent) as host_context:
            context.command.invoke(host_context)
        return
    from devkit.hosting.host import HostOptions, run_host
    from devkit.hosting.joining import run_join
    from schemas.sections.foreign import Foreign
    from schemas.sections.stack_identity import StackSource
    from schemas.wire.expected import Expected
    from twin.fabric.keys.key_file import load_key
    from twin.fabric.keys.roles import Role

    if join is not None:
        if key is not None:
            raise UsageError(f"--key {key}: rigs announced in {join} have keys of their own there")
        raise typer.Exit(run_join(join, commands=commands))
    if not (connect and rig and (stack or foreign)):
        raise UsageError("give --connect, --rig and --stack, or --join FOLDER")
    values = parsed_parameters(parameters)
    options = HostOptions(
        connect=connect,
        rig=rig,
        namespace=namespace,
        slots=slots,
        stack=stack,
        parameters=values,
        key=load_key(key, Role.stack) if key else None,
        foreign=_decoded("--foreign", foreign, Foreign) if foreign else None,
        expected=_decoded("--expected", expected, list[Expected]),
        source=_decoded("--source", source, StackSource),
        view=decode(sandbox) if sandbox else None,
    )
    raise typer.Exit(run_host(options))


def _decoded(option: str, text: str, kind: type[T]) -> T:
    try:
        return msgspec.json.decode(text, type=kind)
    except msgspec.MsgspecError as error:
        raise UsageError(f"{option}: {error}") from None


def main() -> None:
    """Entry point."""
    run(app, "devkit")
