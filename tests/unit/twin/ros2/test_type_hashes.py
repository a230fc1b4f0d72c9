"""RIHS01 hashes against published ones.

Published: in the header ``CdrTopicInfo`` of CARLA's native ROS 2 interface (stacks of ROS 2 Humble
to Jazzy were matched with it), in the Elixir client of ROS 2 ``Ros2.VisionMsgs`` (vision_msgs), in
the table of service hashes of RaftROS (std_srvs), in rmw_zenoh's design document (String). No
published hash was found for autoware_perception_msgs and radar_msgs: theirs follow from the
published interfaces alone.
"""

from __future__ import annotations

import pytest

from twin.base.errors import UsageError
from twin.ros2.store import packages, type_store

PUBLISHED = {
    "ackermann_msgs/msg/AckermannDrive": (
        "acf287a224a947dd1b0b87d6d76cdb73f497b0237b8fc73be2173b2ebbb82c99"
    ),
    "ackermann_msgs/msg/AckermannDriveStamped": (
        "48ca7612a08d3bb72744fd98b71b7cf2ea24c6ad50fa4e1aa0bbad963c90d8cf"
    ),
    "sensor_msgs/msg/CameraInfo": (
        "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"
    ),
    "rosgraph_msgs/msg/Clock": ("692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
    "autoware_control_msgs/msg/Control": (
        "7818be59aa790ebb777db06e55a2c15e3756de4cc35c80b1e8271afc5bab2e9d"
    ),
    "autoware_control_msgs/msg/Lateral": (
        "94d39634041a92db4e460dae93def564fbeb89142e9c64f9c2ed540a182935a1"
    ),
    "autoware_control_msgs/msg/Longitudinal": (
        "4ac4a6b5085ee6bb12067b763568abbf68ec3f2baf64b49e1da360aa6413edc1"
    ),
    "autoware_vehicle_msgs/msg/ControlModeReport": (
        "968feaa6441be3c3b161f2eb65972a4b15394d0a7ddc4664318551280d1ff222"
    ),
    "autoware_vehicle_msgs/msg/Engage": (
        "a865a0a669052a5bb45be203266058660ae8b3be8d080c4567f78d8174f4849e"
    ),
    "autoware_vehicle_msgs/msg/GearCommand": (
        "4aa982c6505fafa9bdca2d243d0a71e46ff9a1e7013767f13a533d0a5d30a1a6"
    ),
    "autoware_vehicle_msgs/msg/GearReport": (
        "4d14bc3f186c1a6af6a732bb5ebd540cdd742a56770012f4c3cb9e762de8f391"
    ),
    "autoware_vehicle_msgs/msg/HazardLightsCommand": (
        "ad2386a78a210625f1fb35f8043ef4e78da58cf01f33c340fa9468e5e8cdd0bc"
    ),
    "autoware_vehicle_msgs/msg/HazardLightsReport": (
        "01ce3b4293a5c2799fd7483b2d62a790e26fe8f2b5d60e48149163475685f28a"
    ),
    "autoware_vehicle_msgs/msg/SteeringReport": (
        "aa3acc9ca95ebc4daf9dec0ecf87911ad9c196392857c3026bfead589db65a94"
    ),
    "autoware_vehicle_msgs/msg/TurnIndicatorsCommand": (
        "657d7f761a9b02c543e4bf3e0000405906b6169dc0bbfd6637c64fe00d98cec7"
    ),
    "autoware_vehicle_msgs/msg/TurnIndicatorsReport": (
        "c05a54cd244f1c9d683613b11c87a5b3ef816eed7a5f207368301221731a0964"
    ),
    "autoware_vehicle_msgs/msg/VelocityReport": (
        "9052adda949c32f4a98500abc1fb5bd23f2560e321eebdfbb25318d6108d4ce4"
    ),
    "std_msgs/msg/String": ("df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
    "std_msgs/msg/Header": ("f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
    "sensor_msgs/msg/Image": ("d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"),
    "sensor_msgs/msg/Imu": ("7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"),
    "sensor_msgs/msg/NavSatFix": (
        "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"
    ),
    "sensor_msgs/msg/PointCloud2": (
        "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"
    ),
    "nav_msgs/msg/Odometry": ("3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"),
    "tf2_msgs/msg/TFMessage": ("e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
    "geometry_msgs/msg/Twist": ("9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"),
    "vision_msgs/msg/Detection3D": (
        "ddd703be132ab0b69d33121f1bb034132bfbb3b0ac5f9fb1516005ba1c8a265b"
    ),
    "vision_msgs/msg/Detection3DArray": (
        "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
    ),
    "std_srvs/srv/Trigger": ("eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"),
    "std_srvs/srv/SetBool": ("abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a"),
    "std_srvs/srv/Empty": ("5888399dedec5ccc85ea6451949fd2c9f97bfdf963f9a588821639fcd31b5d19"),
}


@pytest.mark.parametrize(("name", "published"), PUBLISHED.items())
@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_hash_is_the_published_one(name, published, distribution):
    assert type_store(distribution).type_hash(name) == f"RIHS01_{published}"


def test_every_interface_file_is_a_type_of_every_distribution():
    for distribution in ("jazzy", "kilted", "lyrical"):
        store = type_store(distribution)
        assert store.knows("radar_msgs/msg/RadarTracks")
        assert store.knows("drivetwin_msgs/msg/DriveCommand")
        assert {name.split("/")[0] for name in store.names()} >= set(packages())
        assert all(len(store.type_hash(name)) == 71 for name in store.names())


def test_unknown_types_and_distributions_are_named():
    with pytest.raises(UsageError, match="'foo_msgs/msg/Foo' is not known; known are"):
        type_store().type_hash("foo_msgs/msg/Foo")
    with pytest.raises(UsageError, match="allowed: jazzy, kilted, lyrical"):
        type_store("humble")
