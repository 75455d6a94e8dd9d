"""ROS bags of both kinds, written here and read again."""

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from slamlab.datasets import read_rosbag

STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
ANGLES = np.linspace(-1.0, 1.0, 5)


def scan(store, time, ranges):
    header = head(store, time)
    return store.types["sensor_msgs/msg/LaserScan"](
        header, -1.0, 1.0, 0.5, 0.0, 0.1, 0.2, 10.0, np.float32(ranges), np.float32([])
    )


def odometry(store, time, pose):
    types = store.types
    x, y, yaw = pose
    point = types["geometry_msgs/msg/Point"](x, y, 0.0)
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    nothing = np.zeros(36)
    place = types["geometry_msgs/msg/Pose"](point, turn)
    return types["nav_msgs/msg/Odometry"](
        head(store, time),
        "base",
        types["geometry_msgs/msg/PoseWithCovariance"](place, nothing),
        types["geometry_msgs/msg/TwistWithCovariance"](
            types["geometry_msgs/msg/Twist"](zero, zero), nothing
        ),
    )


def head(store, time):
    stamp = store.types["builtin_interfaces/msg/Time"](int(time), int(1e9 * (time % 1)))
    name = "std_msgs/msg/Header"
    return (
        store.types[name](stamp, "laser")
        if store is STORES[2]
        else store.types[name](0, stamp, "laser")
    )


def write(path, ros, topics):
    """Topics: name -> (type, [(time, message)])."""
    store = STORES[ros]
    writer = Writer1(path) if ros == 1 else Writer2(path, version=8)
    with writer:
        for name, (kind, messages) in topics.items():
            link = writer.add_connection(name, kind, typestore=store)
            for time, message in messages:
                data = (
                    store.serialize_ros1(message, kind)
                    if ros == 1
                    else store.serialize_cdr(message, kind)
                )
                writer.write(link, int(1e9 * time), data)


@pytest.fixture(params=[1, 2])
def bag(request, tmp_path):
    ros, store = request.param, STORES[request.param]
    path = tmp_path / ("drive.bag" if ros == 1 else "drive")
    scans = [(1.0 + k, scan(store, 1.0 + k, [1, 2, np.inf, 0.05, 20.0])) for k in range(3)]
    wheels = [(0.5 * k, odometry(store, 0.5 * k, [0.1 * k, 0.0, 0.02 * k])) for k in range(9)]
    write(
        path,
        ros,
        {
            "/scan": ("sensor_msgs/msg/LaserScan", scans),
            "/odom": ("nav_msgs/msg/Odometry", wheels),
        },
    )
    return path


def test_scans_and_odometry_become_a_log(bag):
    log = read_rosbag(bag)
    assert len(log) == 3
    assert log.times.tolist() == [1, 2, 3]
    np.testing.assert_allclose(log.scan.beam_angles, ANGLES)
    assert log.ranges[0, :2].tolist() == [1, 2]
    assert np.isinf(log.ranges[0, [2, 4]]).all()
    assert np.isnan(log.ranges[0, 3])
    assert log.u[0].tolist() == [0, 0, 0]
    np.testing.assert_allclose(np.hypot(*log.u[1:, :2].T), 0.2, rtol=1e-6)
    np.testing.assert_allclose(log.u[1:, 2], 0.04, rtol=1e-6)


def test_without_odometry_the_robot_may_have_done_anything(tmp_path):
    store = STORES[2]
    path = tmp_path / "bag"
    write(path, 2, {"/s": ("sensor_msgs/msg/LaserScan", [(1.0, scan(store, 1.0, np.ones(5)))])})
    log = read_rosbag(path)
    assert not log.u.any()
    assert log.control_cov[0, 0, 0] > 0.01


def test_what_cannot_be_read_is_said(tmp_path, bag):
    with pytest.raises(FileNotFoundError):
        read_rosbag(tmp_path / "none.bag")
    with pytest.raises(ValueError, match="topic /laser"):
        read_rosbag(bag, scan_topic="/laser")
    rubbish = tmp_path / "rubbish.bag"
    rubbish.write_bytes(b"#ROSBAG V2.0\n" + bytes(range(200)))
    with pytest.raises(ValueError, match="rubbish.bag"):
        read_rosbag(rubbish)
    store = STORES[2]
    messages = [(1.0, scan(store, 1.0, np.ones(5)))]
    several = tmp_path / "several"
    kind = "sensor_msgs/msg/LaserScan"
    write(several, 2, {"/a": (kind, messages), "/b": (kind, messages)})
    with pytest.raises(ValueError, match="one of the topics"):
        read_rosbag(several)
