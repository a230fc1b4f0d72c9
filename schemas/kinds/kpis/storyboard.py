"""KPIs of cases that a storyboard makes: whether it runs, and which of its events have begun."""

from __future__ import annotations

from schemas.kinds.kpi import CurveLook, KpiKind

KPIS = (
    KpiKind(
        name="storyboard_running",
        place="column",
        type="float64",
        doc="1 while the storyboard runs, 0 from the tick on at which it has ended",
        nullable=True,
    ),
    KpiKind(
        name="events_started",
        place="column",
        type="float64",
        doc="Events of the storyboard that have begun so far",
        nullable=True,
        curve=CurveLook(
            place=9,
            title="Events so far",
            axis="count [-]",
            height=0.6,
            steps=True,
            scale="count",
        ),
    ),
    KpiKind(
        name="event_last",
        place="column",
        type="float64",
        doc="Number of the event that began last, counted from 1 as the file has them",
        nullable=True,
    ),
    KpiKind(
        name="event_last_s",
        place="column",
        type="float64",
        unit="s",
        doc="Time at which it began",
        nullable=True,
    ),
    KpiKind(
        name="storyboard_end_s",
        place="scalar",
        type="float64",
        unit="s",
        doc="Control tick at which the storyboard had ended; null: it still ran",
        nullable=True,
        label="Storyboard's end [s]",
        compared="End of the storyboard [s]",
    ),
    KpiKind(
        name="events_started",
        place="scalar",
        type="int32",
        doc="Events of the storyboard that have begun",
        nullable=True,
        label="Events",
        compared="Events that began",
        panel="events",
    ),
    KpiKind(
        name="event_last",
        place="scalar",
        type="int32",
        doc="Number of the event that began last, before the end or the collision",
        nullable=True,
    ),
    KpiKind(
        name="event_last_s",
        place="scalar",
        type="float64",
        unit="s",
        doc="Time at which it began",
        nullable=True,
        label="Last event [s]",
        panel="last event after",
    ),
)
