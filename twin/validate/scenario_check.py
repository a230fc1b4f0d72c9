"""What ``twin validate scenario`` says of a file, and the picture it draws."""

from __future__ import annotations

from pathlib import Path

from twin.base.errors import storage_error
from twin.scenario.storyboard.native.compiler import compile_native
from twin.scenario.storyboard.native.document import is_native, load_native
from twin.scenario.storyboard.native.outline import native_outline
from twin.scenario.storyboard.program.program import Program


def check_scenario(file: Path, distribution: Path | None) -> tuple[list[str], list[str]]:
    """Lines that say what a scenario does, and notes about what has no effect.

    Raises:
        ValueError: a line per mistake.
    """
    if is_native(str(file)):
        if distribution is not None:
            raise ValueError(f"{file}: a campaign varies scenario files, no distribution does")
        document = load_native(file)
        return native_outline(document, compile_native(document)), []
    from twin.scenario.storyboard.apart import outline_apart, permutations_apart

    permutations = permutations_apart(file, distribution)
    if not permutations:
        return [], []
    return outline_apart(file, permutations[0], len(permutations))


def draw_scenario(file: Path, distribution: Path | None, picture: Path) -> None:
    """Play a scenario and draw it; of a distribution the first permutation.

    Raises:
        ValueError: it cannot be played, or ``picture`` is no name of a picture.
        UsageError: the program is larger than a limit.
        InfrastructureError: the picture cannot be written.
    """
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels

    from twin.road.opendrive.road_map import RoadMap
    from twin.validate.scenario_picture import write_scenario_picture
    from twin.validate.scenario_play import play_scenario

    program = _program(file, distribution)
    roads = None if program.network is None else RoadMap(program.network)
    try:
        write_scenario_picture(picture, roads, play_scenario(program))
    except OSError as error:
        raise storage_error(error, str(picture)) from None


def _program(file: Path, distribution: Path | None) -> Program:
    if is_native(str(file)):
        return compile_native(load_native(file))
    from twin.scenario.storyboard.apart import permutations_apart, program_apart

    permutations = permutations_apart(file, distribution)
    if not permutations:
        raise ValueError(f"{distribution}: no permutation")
    return program_apart(file, permutations[0])
