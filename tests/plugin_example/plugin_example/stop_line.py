from twin.scenario.protocol import Verdict


class StopLine:
    def __init__(self, config, ground, x_m, y_m):
        self._config, self._lane = config, ground.lane
        self._to_line_m = config.line_m

    @classmethod
    def start(cls, config, ground):
        pose = ground.lane.at(0.0)
        return float(pose.x_m), float(pose.y_m), float(pose.yaw_rad)

    def observe(self, x_m, y_m):
        if len(x_m):
            driven_m = float(self._lane.locate(x_m[-1], y_m[-1]).s_m)
            self._to_line_m = self._config.line_m - driven_m

    def columns(self):
        return {"to_line_m": self._to_line_m}

    def ended(self):
        return self._to_line_m < 0.0

    def scalars(self, rows):
        return {"stopped_before_m": self._to_line_m}

    def judge(self, rows, moved):
        at_m = self._to_line_m
        if at_m < 0.0:
            return Verdict("over_the_line", [f"{-at_m:.2f} m over the line"])
        if rows.column("speed_mps")[-1] > 0.0:
            return Verdict("time_up", [f"time is up {at_m:.2f} m before the line"])
        word = "pass" if at_m <= self._config.short_max_m else "too_short"
        return Verdict(word, [f"stopped {at_m:.2f} m before the line"])
