from schemas.kinds.kpi import CurveLook, KpiKind

KPIS = (
    KpiKind(
        name="jerk_mps3",
        place="column",
        type="float64",
        unit="m/s^3",
        doc="Change of the ego's acceleration, forward",
        nullable=True,
        curve=CurveLook(place=8, title="Jerk", axis="jerk [m/s^3]", scale="signed"),
        implementation="plugin_example.jerk:jerk",
    ),
    KpiKind(
        name="jerk_peak_mps3",
        place="scalar",
        type="float64",
        unit="m/s^3",
        nullable=True,
        label="Jerk, peak [m/s^3]",
        better="less",
        compared="Largest jerk [m/s^3]",
        implementation="plugin_example.jerk:jerk_peak",
    ),
)
