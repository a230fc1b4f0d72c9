"""``.msg`` files for nodes that are not ours, written from the type store."""

from pathlib import Path

from twin.ros2.store import type_store

TYPES = (
    *("drivetwin_msgs/msg/DriveCommand", "drivetwin_msgs/msg/Episode", "drivetwin_msgs/msg/Tick"),
    *("drivetwin_msgs/msg/SensorArray", "sensor_msgs/msg/Image", "rosgraph_msgs/msg/Clock"),
    *("ackermann_msgs/msg/AckermannDriveStamped", "geometry_msgs/msg/Twist"),
    *("geometry_msgs/msg/TwistStamped", "std_msgs/msg/String", "sensor_msgs/msg/CompressedImage"),
    "sensor_msgs/msg/PointCloud2",
)


def write_interfaces(folder: Path) -> Path:
    """Files of :data:`TYPES` and all that they use, ``<package>/msg/<Name>.msg``."""
    store = type_store()
    for type_name in TYPES:
        first, *others = store.definition(type_name).split("=" * 80 + "\n")
        _write(folder, type_name, first)
        for other in others:
            head, _, body = other.partition("\n")
            name = head.removeprefix("MSG: ").strip()
            package, _, rest = name.partition("/")
            _write(folder, name if rest.startswith("msg/") else f"{package}/msg/{rest}", body)
    return folder


def _write(folder: Path, type_name: str, text: str) -> None:
    path = folder / f"{type_name}.msg"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
