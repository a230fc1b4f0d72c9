"""Commands of ``hpc`` that make software travel: ``image build``, ``bundle`` and ``fetch``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from hpc.software.enter import enter, leave
from twin.base.cli import Output, OutputOption
from twin.base.progress import bars

Source = Annotated[
    Path | None,
    typer.Option(help="The project's checkout; default: the one this command runs from."),
]

Cache = Annotated[Path, typer.Option(help="Folder on the file system that the nodes share.")]


def add_commands(app: typer.Typer) -> None:
    """Add the commands to the ``hpc`` command."""
    image = typer.Typer(
        name="image",
        help="Container images for clusters.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    image.command("build")(build_image)
    image.command("context")(write_image_context)
    app.add_typer(image)
    app.command("bundle")(bundle)
    app.command("enter", context_settings={"allow_interspersed_args": False})(enter)
    app.command("leave")(leave)
    fetch = typer.Typer(
        name="fetch",
        help="Fetch what a campaign needs from the internet; compute nodes have none.",
        no_args_is_help=True,
        rich_markup_mode=None,
    )
    fetch.command("repository")(fetch_repository)
    fetch.command("image")(fetch_image)
    app.add_typer(fetch)


def build_image(
    out: Annotated[
        Path, typer.Option(help="Image to write: FILE.sif, or a folder for charliecloud.")
    ] = Path("drivetwin.sif"),
    wheels: Annotated[
        Path | None,
        typer.Option(help="Folder of wheels (of `hpc bundle`); default: built and downloaded."),
    ] = None,
    base: Annotated[
        str,
        typer.Option(
            help="Image with Python to start from: docker://NAME or a path; default: the official "
            "Python image of this Python's version."
        ),
    ] = "",
    source: Source = None,
    only_print: Annotated[
        bool, typer.Option("--print", help="Print the definition and build nothing.")
    ] = False,
) -> None:
    """Build an Apptainer image with everything that compute nodes need.

    No root is needed. With --wheels and a --base that is a file, no network is needed either.
    """
    from hpc.software.image import build, default_base, definition
    from hpc.software.wheels import source_folder

    start = str(Path(base).absolute()) if base and Path(base).exists() else base or default_base()
    if only_print:
        print(definition(start), end="")
        return
    with bars():
        build(source_folder(source), out, start, wheels)
    print(out.absolute())


def write_image_context(
    out: Annotated[Path, typer.Argument(help="New folder to write.")],
    wheels: Annotated[
        Path | None,
        typer.Option(help="Folder of wheels (of `hpc bundle`); default: built and downloaded."),
    ] = None,
    base: Annotated[
        str,
        typer.Option(help="Image with Python to start from; default: this Python's official one."),
    ] = "",
    extra: Annotated[
        list[str] | None,
        typer.Option(help="Extra of the project to install too, repeatable, e.g. store."),
    ] = None,
    source: Source = None,
) -> None:
    """Write what an OCI image is built from: a Containerfile and wheels.

    `podman build` or `docker build` makes the image, for clusters whose nodes pull images.
    """
    from hpc.software.image import default_base, write_context
    from hpc.software.wheels import checked_extras, source_folder

    folder = source_folder(source)
    extras = checked_extras(folder, extra or [])
    with bars():
        write_context(folder, out, base or default_base(), wheels, extras)
    print(f"{out.absolute()}; then: podman build --tag NAME {out.absolute()}")


def bundle(
    out: Annotated[Path, typer.Option(help="New folder to write.")] = Path("drivetwin-bundle"),
    device: Annotated[
        list[str] | None,
        typer.Option(help="Compile kernels on cpu or cuda:N, repeatable; default: cpu."),
    ] = None,
    campaign: Annotated[
        list[str] | None,
        typer.Option(
            help="Add the kernels of this campaign's first case and its checked networks, so that "
            "its first run waits for neither; name or file, repeatable."
        ),
    ] = None,
    no_kernels: Annotated[
        bool, typer.Option("--no-kernels", help="Compile none; nodes do it themselves.")
    ] = False,
    source: Source = None,
) -> None:
    """Write wheels, kernels and an install.sh for compute nodes without internet.

    The nodes must have this machine's Python version and architecture.
    """
    from hpc.software.bundle import write_bundle
    from hpc.software.wheels import source_folder

    with bars():
        devices = [] if no_kernels else device or ["cpu"]
        write_bundle(source_folder(source), out, devices, campaign or [])
    print(f"{out.absolute()}; on a node: {out.absolute()}/install.sh VENV")


def fetch_repository(
    url: Annotated[str, typer.Argument(help="What git clones: a URL or the path of a clone.")],
    ref: Annotated[str, typer.Option(help="Branch, tag or commit.")] = "HEAD",
    setup: Annotated[
        str, typer.Option(help="Shell command to run in the files once, e.g. a build.")
    ] = "",
    cache: Cache = Path("inputs"),
    output: OutputOption = Output.human,
) -> None:
    """Fetch a repository, read-only, and print its folder.

    The folder's name is the digest of content and set-up: it never changes, and what is there
    already is not fetched again.
    """
    from hpc.inputs import NamedRepository
    from hpc.inputs import fetch_repository as fetch

    fetched = fetch(NamedRepository(url, ref, setup), cache)
    if output is Output.json:
        facts = {"folder": str(fetched.folder), "commit": fetched.commit, "key": fetched.key}
        print(json.dumps(facts))
    else:
        print(fetched.folder)


def fetch_image(
    image: Annotated[str, typer.Argument(help="Path, or docker://NAME[:TAG].")],
    cache: Cache = Path("inputs"),
    refresh: Annotated[
        bool, typer.Option("--refresh", help="Pull again what was pulled under this name.")
    ] = False,
) -> None:
    """Fetch a container image, read-only, and print its path."""
    from hpc.inputs import fetch_image as fetch

    print(fetch(image, cache, refresh=refresh))
