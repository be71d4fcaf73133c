"""A node of ROS 2 (Humble or later) that publishes the tracks of a fixed LiDAR's clouds.

    python3 ros2_tracks.py --height-m 6 --region outline.yaml --ros-args -r points:=/lidar/points

Options before `--ros-args` are those of `pyinfra detect --follow`. The node writes the clouds of
the topic `points` to a folder in memory and publishes the tracks of this command as `tracks`, a
vision_msgs/Detection3DArray. The id of a detection is that of its track, and the twist is left out.
The LiDAR must be level, with z up. Clouds that arrive while the machine is busy are dropped.
"""

import json
import math
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import remove_ros_args
from sensor_msgs.msg import PointCloud2
from sensor_msgs_py import point_cloud2
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

FIELDS = ("x", "y", "z", "intensity")
KEPT = 20  # clouds in the folder


class TracksNode(Node):
    def __init__(self, options: list[str], folder: Path) -> None:
        super().__init__("pyinfra_tracks")
        self.folder, self.stamps = folder, {}
        self.publisher = self.create_publisher(Detection3DArray, "tracks", 10)
        words = ["pyinfra", "detect", str(folder), "--follow", *options]
        self.command = subprocess.Popen(
            [sys.executable, "-m", *words], stdout=subprocess.PIPE, text=True
        )
        self.create_subscription(PointCloud2, "points", self.save, qos_profile_sensor_data)
        self.reader = threading.Thread(target=self.publish_all)
        self.reader.start()

    def save(self, cloud: PointCloud2) -> None:
        """Writes a cloud under the name of its time."""
        points = point_cloud2.read_points(cloud, field_names=FIELDS, skip_nans=True)
        columns = np.stack([points[name] for name in FIELDS], axis=1).astype("<f4")
        stamp = cloud.header.stamp
        name = f"{stamp.sec:010d}.{stamp.nanosec:09d}"
        beside = self.folder / "writing"
        beside.write_bytes(columns.tobytes())
        beside.rename(self.folder / f"{name}.bin")
        self.stamps[round(float(name), 6)] = cloud.header
        for old in sorted(self.folder.glob("*.bin"))[:-KEPT]:
            old.unlink()
        for time_s in sorted(self.stamps)[:-KEPT]:
            del self.stamps[time_s]

    def end(self) -> None:
        """Ends the command and the thread that reads it."""
        with self.command:
            self.command.terminate()
            self.reader.join()

    def publish_all(self) -> None:
        """Publishes a message for each line of the command."""
        for text in self.command.stdout:
            line = json.loads(text)
            header = self.stamps.get(line["t_s"])
            if header is not None:
                detections = [detection(header, track) for track in line["tracks"]]
                self.publisher.publish(Detection3DArray(header=header, detections=detections))


def detection(header: object, track: dict) -> Detection3D:
    """Returns the message of a track."""
    half = track["heading"] / 2
    pose = Pose(
        position=Point(x=track["x"], y=track["y"], z=track["z"]),
        orientation=Quaternion(z=math.sin(half), w=math.cos(half)),
    )
    result = ObjectHypothesisWithPose()
    result.hypothesis.class_id, result.hypothesis.score = track["type"], track["score"]
    result.pose.pose = pose
    message = Detection3D(header=header, results=[result], id=str(track["id"]))
    message.bbox.center = pose
    message.bbox.size = Vector3(x=track["dx"], y=track["dy"], z=track["dz"])
    return message


def main() -> None:
    rclpy.init(args=sys.argv)
    options = remove_ros_args(sys.argv)[1:]
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        node = TracksNode(options, Path(folder))
        try:
            rclpy.spin(node)
        finally:
            node.end()


if __name__ == "__main__":
    main()
