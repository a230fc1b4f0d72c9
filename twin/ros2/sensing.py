"""Arrays of one car's sensors -> ROS 2 messages: pictures, points, inertia, satellites, radar.

All are pure: the same arrays give the same bytes, live and in a recording.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.kinds.sensor import Ros2Form
from schemas.messages import BOX_COLUMNS, OBJECT_CLASSES, CameraSite, LidarSite
from schemas.sections.lens_curve import intrinsics
from twin.base.picture_file import jpeg_of
from twin.ros2.parts import MessageParts

JPEG_QUALITY = 90
"""Quality of compressed pictures, 0 to 100."""

_DISTORTION = {
    "frustum": ("plumb_bob", ()),
    "pinhole": ("plumb_bob", ()),
    "brown_conrady": ("rational_polynomial", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "fisheye": ("equidistant", ("k1", "k2", "k3", "k4")),
}
"""Lens model -> model and coefficients of sensor_msgs/CameraInfo (distortion_models.hpp)."""

_NO_FIX, _FIX, _GPS, _UNKNOWN_COVARIANCE = -1, 0, 1, 0
_FLOAT32, _UINT8, _UINT16 = 7, 2, 4
_XYZIRC = np.dtype(
    [
        *(("x", "<f4"), ("y", "<f4"), ("z", "<f4")),
        *(("intensity", "|u1"), ("return_type", "|u1"), ("channel", "<u2")),
    ]
)
"""Autoware's PointXYZIRC, 16 bytes."""
_SINGLE_STRONGEST = 1
_DATATYPES = {"<f4": _FLOAT32, "|u1": _UINT8, "<u2": _UINT16}
_DEPTH = {"uint8": "mono8", "uint16": "mono16", "float32": "32FC1"}

Floats = NDArray[np.floating[Any]]


class SensorMessages(MessageParts):
    """Makes messages of sensors."""

    def image(self, time_ns: int, frame: str, pixels: NDArray[Any]) -> Any:
        """sensor_msgs/Image of uint8 [H, W, 3] (``rgb8``) or one value per pixel [H, W]."""
        height, width = pixels.shape[:2]
        encoding = "rgb8" if pixels.ndim == 3 else _DEPTH[pixels.dtype.name]
        data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
        return self.store.make(
            "sensor_msgs/msg/Image",
            header=self.header(time_ns, frame),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=int(sys.byteorder == "big"),
            step=data.size // height if height else 0,
            data=data,
        )

    def compressed_image(self, time_ns: int, frame: str, pixels: NDArray[np.uint8]) -> Any:
        """sensor_msgs/CompressedImage (JPEG) of uint8 [H, W, 3], RGB."""
        return self.store.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(time_ns, frame),
            format="rgb8; jpeg compressed bgr8",
            data=np.frombuffer(jpeg_of(pixels, JPEG_QUALITY), np.uint8),
        )

    def camera_info(self, time_ns: int, frame: str, site: CameraSite) -> Any:
        """sensor_msgs/CameraInfo; pixel centres at whole numbers, as image_geometry has them."""
        lens = site.lens
        inner = intrinsics(lens, site.width, site.height, site.hfov_deg)
        fx, fy, cx, cy = inner.fx_px, inner.fy_px, inner.cx_px - 0.5, inner.cy_px - 0.5
        model, names = _DISTORTION[lens.model]
        region = self.store.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        return self.store.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(time_ns, frame),
            height=site.height,
            width=site.width,
            distortion_model=model,
            d=np.array([getattr(lens, name) for name in names] or [0.0] * 5),
            k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
            r=np.eye(3).reshape(-1),
            p=np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
            binning_x=0,
            binning_y=0,
            roi=region,
        )

    def points(self, time_ns: int, frame: str, site: LidarSite, rows: Floats, layout: str) -> Any:
        """sensor_msgs/PointCloud2 of float32 [channels x columns, K].

        Args:
            time_ns: sim time.
            frame: of the sensor.
            site: names the columns.
            rows: the sweep.
            layout: see :attr:`twin.ros2.tables.SensorTopic.layout`.
        """
        if layout == "xyzirc":
            packed = _xyzirc(site, rows)
            return self._cloud(time_ns, frame, packed, (1, len(packed)), True)
        names = [name.removesuffix("_m") if name[0] in "xyz" else name for name in site.fields]
        whole = np.ascontiguousarray(rows, "<f4").view([(name, "<f4") for name in names])
        return self._cloud(time_ns, frame, whole[:, 0], (site.channels, site.columns), False)

    def _cloud(
        self, time_ns: int, frame: str, packed: NDArray[Any], size: tuple[int, int], dense: bool
    ) -> Any:
        stride = packed.dtype.itemsize
        fields = [
            self.store.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=int(offset),
                datatype=_DATATYPES[dtype.str],
                count=1,
            )
            for name, (dtype, offset, *_) in (packed.dtype.fields or {}).items()
        ]
        height, width = size
        return self.store.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time_ns, frame),
            height=height,
            width=width,
            fields=fields,
            is_bigendian=False,
            point_step=stride,
            row_step=stride * width,
            data=np.ascontiguousarray(packed).view(np.uint8).reshape(-1),
            is_dense=dense,
        )

    def of_form(
        self,
        time_ns: int,
        frame: str,
        form: Ros2Form,
        columns: Sequence[str],
        values: Floats,
    ) -> Any:
        """Message of a sensor whose declaration names one.

        Args:
            time_ns: sim time.
            frame: of the sensor.
            form: what its declaration says.
            columns: of its rows.
            values: a row, or the valid ones of its rows.
        """
        makers = {
            "sensor_msgs/msg/Imu": self._inertial,
            "sensor_msgs/msg/NavSatFix": self._fix,
            "radar_msgs/msg/RadarScan": self._returns,
        }
        fields = {key: values[..., columns.index(name)] for key, name in form.fields.items()}
        return makers[form.type_name](self.header(time_ns, frame), fields)

    def _inertial(self, header: Any, row: Mapping[str, Any]) -> Any:
        """A message without an orientation (REP 145)."""
        unknown = np.zeros(9)
        unknown[0] = -1.0
        return self.store.make(
            "sensor_msgs/msg/Imu",
            header=header,
            orientation=self.quaternion((0.0, 0.0, 0.0, 1.0)),
            orientation_covariance=unknown,
            angular_velocity=self.vector(*(row[f"angular_velocity.{axis}"] for axis in "xyz")),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(
                *(row[f"linear_acceleration.{axis}"] for axis in "xyz")
            ),
            linear_acceleration_covariance=np.zeros(9),
        )

    def _fix(self, header: Any, row: Mapping[str, Any]) -> Any:
        """NaN in a dropout."""
        valid = _FIX if row["status"] == 1.0 else _NO_FIX
        return self.store.make(
            "sensor_msgs/msg/NavSatFix",
            header=header,
            status=self.store.make("sensor_msgs/msg/NavSatStatus", status=valid, service=_GPS),
            latitude=float(row["latitude"]),
            longitude=float(row["longitude"]),
            altitude=float(row["altitude"]),
            position_covariance=np.zeros(9),
            position_covariance_type=_UNKNOWN_COVARIANCE,
        )

    def _returns(self, header: Any, rows: Mapping[str, Any]) -> Any:
        columns = [values.tolist() for values in rows.values()]
        returns = [
            self.store.make("radar_msgs/msg/RadarReturn", **dict(zip(rows, row, strict=True)))
            for row in zip(*columns, strict=True)
        ]
        return self.store.make("radar_msgs/msg/RadarScan", header=header, returns=returns)

    def boxes(self, time_ns: int, frame: str, rows: Floats) -> Any:
        """vision_msgs/Detection2DArray of rows of ``BOX_COLUMNS``: the truth."""
        header = self.header(time_ns, frame)
        found = []
        for values in rows.tolist():
            row = dict(zip(BOX_COLUMNS, values, strict=True))
            middle = self.store.make(
                "vision_msgs/msg/Point2D",
                x=row["x_px"] + 0.5 * row["width_px"],
                y=row["y_px"] + 0.5 * row["height_px"],
            )
            box = self.store.make(
                "vision_msgs/msg/BoundingBox2D",
                center=self.store.make("vision_msgs/msg/Pose2D", position=middle, theta=0.0),
                size_x=row["width_px"],
                size_y=row["height_px"],
            )
            name = OBJECT_CLASSES[int(row["class_id"])]
            found.append(
                self.store.make(
                    "vision_msgs/msg/Detection2D",
                    header=header,
                    results=[self.hypothesis(name, (0.0, 0.0, row["distance_m"]))],
                    bbox=box,
                    id="",
                )
            )
        return self.store.make("vision_msgs/msg/Detection2DArray", header=header, detections=found)

    def hypothesis(
        self, name: str, position_m: tuple[float, float, float], turn: tuple[float, ...] = ()
    ) -> Any:
        """vision_msgs/ObjectHypothesisWithPose, of whose class nobody doubts."""
        certain = self.store.make("vision_msgs/msg/ObjectHypothesis", class_id=name, score=1.0)
        pose = self.pose_with_covariance(position_m, turn or (0.0, 0.0, 0.0, 1.0))
        return self.store.make(
            "vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=certain, pose=pose
        )


def _xyzirc(site: LidarSite, rows: Floats) -> NDArray[Any]:
    columns = {name: rows[:, number] for number, name in enumerate(site.fields)}
    hits = np.flatnonzero(np.isfinite(columns["x_m"]))
    packed = np.zeros(len(hits), _XYZIRC)
    for name in "xyz":
        packed[name] = columns[f"{name}_m"][hits]
    packed["intensity"] = np.clip(np.rint(columns["intensity"][hits]), 0, 255)
    packed["return_type"] = _SINGLE_STRONGEST
    packed["channel"] = hits // site.columns
    return packed
