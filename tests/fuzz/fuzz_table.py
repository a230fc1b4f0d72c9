"""Every decoder of the project, by name."""

from __future__ import annotations

import targets_assets
import targets_certificates
import targets_clusters
import targets_files
import targets_roads
import targets_ros2
import targets_ros2_wire
import targets_scenarios
import targets_stores
import targets_wire
from fuzz_target import Target

TARGETS: dict[str, Target] = {
    **targets_wire.TARGETS,
    **targets_ros2_wire.TARGETS,
    **targets_files.TARGETS,
    **targets_assets.TARGETS,
    **targets_roads.TARGETS,
    **targets_ros2.TARGETS,
    **targets_certificates.TARGETS,
    **targets_scenarios.TARGETS,
    **targets_stores.TARGETS,
    **targets_clusters.TARGETS,
}
