"""Scores of a detector as Markdown, for a terminal and for model cards."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from devkit.detector.evaluate import Score, Scores, table
from devkit.detector.scoring import (
    CONFIDENCE_SHOWN,
    MERIT,
    NIGHT,
    NOON,
    RecallShare,
    Scorecard,
)

OBJECTS_MIN = 20
"""A score of fewer objects stands in brackets: one object more or less changes it visibly."""

WORST = 5
"""Cells that are named as the worst."""


def merit_line(card: Scorecard) -> str:
    """The figure of merit in one line."""
    hours = f"{NOON[1]:.0f}:00 to {NOON[2] - 1:.0f}:59"
    where = f"{MERIT} at clear noon ({NOON[0]}, {hours})"
    if card.noon is None or card.noon.ap is None:
        return f"{where}: no such object in these images"
    objects = f"{card.noon.truths} objects in {card.noon_images} images"
    return f"{where}: AP@0.5 {100.0 * card.noon.ap:.1f} ({objects})"


def moderate_lines(card: Scorecard) -> str:
    """Scores of the objects that KITTI's level "moderate" asks for, in two lines."""
    classes = [
        f"{name} {_percent(score.ap)} of {score.truths}"
        for name, score in card.moderate.classes.items()
    ]
    noon = card.noon_moderate
    merit = f"; {MERIT} at clear noon {_percent(noon.ap)} of {noon.truths}" if noon else ""
    return (
        "Large and visible objects alone, as KITTI's level moderate (height of at least 25 of 375"
        " image rows, visibility of 0.5, 0.3 truncated): mAP@0.5"
        f" {_percent(card.moderate.mean_ap)} ({', '.join(classes)}){merit}\n"
    )


def score_table(card: Scorecard) -> str:
    """All classes, by hour and by weather."""
    result = card.evaluation
    shown = {label: result.groups[label] for label in ("hour", "weather")}
    return table(type(result)(result.method, result.overlap_min, result.all, shown))


def joint_table(card: Scorecard) -> str:
    """Average precision of :data:`MERIT`: a row per block of hours, a column per weather."""
    cells = joint_cells(card)
    if not cells:
        return ""
    weathers = sorted({weather for _, weather in cells})
    blocks = sorted({block for block, _ in cells}, key=lambda block: (block == NIGHT, block))
    lines = [
        f"| {MERIT}: hours | {' | '.join(weathers)} |",
        f"|---|{'--:|' * len(weathers)}",
    ]
    for block in blocks:
        row = [_cell(cells.get((block, weather))) for weather in weathers]
        lines.append(f"| {_hours(block)} | {' | '.join(row)} |")
    lines += ["", f"In brackets: fewer than {OBJECTS_MIN} objects."]
    return "\n".join(lines) + "\n"


def joint_cells(card: Scorecard) -> dict[tuple[str, str], Score]:
    """(block of hours, weather) -> score of :data:`MERIT`; empty without this class."""
    cells = {}
    for key, scores in card.evaluation.groups["joint"].items():
        block, _, weather = key.partition(" ")
        if MERIT in scores.classes:
            cells[block, weather] = scores.classes[MERIT]
    return cells


def recall_tables(card: Scorecard) -> str:
    """Which objects are reported, by size, distance and visibility."""
    titles = {"size_px": "longer side [px]", "distance_m": "distance [m]"}
    parts = [
        recall_table(titles.get(measure, measure), groups)
        for measure, groups in card.recalls.items()
    ]
    return "\n".join(parts)


def recall_table(title: str, groups: Mapping[str, Mapping[str, RecallShare]]) -> str:
    """One row per group: found of all, in per cent, by class."""
    names = list(next(iter(groups.values())))
    lines = [f"| {title} | {' | '.join(names)} |", f"|---|{'--:|' * len(names)}"]
    for group, classes in groups.items():
        cells = [_share(classes[name]) for name in names]
        lines.append(f"| {group} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def failures(card: Scorecard) -> list[str]:
    """What the scores say about when not to trust the detector, one sentence each."""
    return [*_worst_cells(card), *_worst_groups(card), *_small(card)]


def _worst_cells(card: Scorecard) -> Iterator[str]:
    cells = {
        key: score
        for key, score in joint_cells(card).items()
        if score.ap is not None and score.truths >= OBJECTS_MIN
    }
    worst = sorted(cells, key=lambda key: (cells[key].ap, key))[:WORST]
    if worst:
        named = [f"{_hours(b)} {w} {100.0 * (cells[b, w].ap or 0.0):.1f}" for b, w in worst]
        yield f"Lowest AP of {MERIT} by hours and weather: {', '.join(named)}."


def _worst_groups(card: Scorecard) -> Iterator[str]:
    for label in ("hour", "weather"):
        groups = card.evaluation.groups[label]
        known = {k: s.mean_ap for k, s in groups.items() if s.mean_ap is not None and _many(s)}
        if len(known) > 1:
            low = min(known, key=lambda key: (known[key], key))
            high = max(known, key=lambda key: (known[key], key))
            yield (
                f"By {label}, mAP falls from {100.0 * known[high]:.1f} ({high}) to"
                f" {100.0 * known[low]:.1f} ({low})."
            )


def _small(card: Scorecard) -> Iterator[str]:
    """Groups of which less than half is reported."""
    units = {"size_px": "px long", "distance_m": "m away", "visibility": "visible"}
    for measure, groups in card.recalls.items():
        lost = [
            f"{name} {group} {units[measure]} ({_share(share)} of {share.objects})"
            for group, classes in groups.items()
            for name, share in classes.items()
            if share.objects >= OBJECTS_MIN and 2 * share.found < share.objects
        ]
        if lost:
            yield (
                f"At confidence {CONFIDENCE_SHOWN:g} less than half of these is reported:"
                f" {', '.join(lost)}."
            )


def _many(scores: Scores) -> bool:
    return sum(score.truths for score in scores.classes.values()) >= OBJECTS_MIN


def _cell(score: Score | None) -> str:
    if score is None or score.ap is None:
        return "-"
    text = f"{100.0 * score.ap:.0f}"
    return text if score.truths >= OBJECTS_MIN else f"({text})"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.1f}"


def _share(share: RecallShare) -> str:
    return f"{100.0 * share.found / share.objects:.0f} %" if share.objects else "-"


def _hours(block: str) -> str:
    if block == NIGHT:
        return "20:00 to 3:59"
    return f"{int(block) - 1}:00 to {int(block)}:59"


def report(card: Scorecard) -> str:
    """All tables of a scorecard, in Markdown."""
    parts = [
        merit_line(card) + "\n",
        moderate_lines(card),
        score_table(card),
        joint_table(card),
        recall_tables(card),
    ]
    return "\n".join(part for part in parts if part)
