"""A thermometer, a scenario "stop at the line", KPIs of jerk, and a batch system."""
