"""ROS bags of both kinds, written here and read again."""

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from slamlab.commands import main
from slamlab.datasets.rosbag import read_rosbag
from tests.fuzzing import ROUNDS, damage

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


# Fields of the messages of a drive of eight scans; each accident changes one message or all.
ACCIDENTS = {
    "a scan of other beams": ("scan", 3, "ranges", np.ones(4, np.float32)),
    "scans of no beam": ("scan", None, "ranges", np.ones(0, np.float32)),
    "a scan of nan": ("scan", 3, "ranges", np.full(5, np.nan, np.float32)),
    "scans of nothing": ("scan", None, "ranges", np.full(5, np.inf, np.float32)),
    "scans of -inf": ("scan", None, "ranges", np.full(5, -np.inf, np.float32)),
    "ranges of 3e38": ("scan", None, "ranges", np.full(5, 3e38, np.float32)),
    "beams of nan": ("scan", None, "angle_min", np.nan),
    "beams of inf": ("scan", None, "angle_increment", np.inf),
    "a turned lidar": ("scan", 3, "angle_min", 0.0),
    "no sight": ("scan", None, "range_max", 0.0),
    "sight of nan": ("scan", None, "range_max", np.nan),
    "sight of inf": ("scan", None, "range_max", np.inf),
    "nothing near enough": ("scan", None, "range_min", 1e30),
    "wheels of nan": ("position", 3, "x", np.nan),
    "wheels of 1e308": ("position", 3, "x", 1e308),
    "wheels of 1e7": ("position", 3, "y", 1e7),
    "a turn of nan": ("orientation", 3, "z", np.nan),
    "a turn of 1e308": ("orientation", None, "w", 1e308),
    "a turn of nothing": ("orientation", None, "w", 0.0),
    "time going back": ("stamp", 3, "sec", -(2**31)),
    "time running ahead": ("stamp", 3, "sec", 2**31 - 1),
    "time standing still": ("stamp", None, "sec", 5),
}


def drive(ros, part="", which=None, name="", value=None, wheels=8, scans=8):
    """Messages of a drive, one field of one of them (or of all) changed."""
    store = STORES[ros]
    seen = [scan(store, k, [1, 2, 2, 2, 1]) for k in range(scans)]
    driven = [odometry(store, k, [0.1 * k, 0.0, 0.02 * k]) for k in range(wheels)]
    for k in range(8):
        if part and which in (None, k):
            pose = driven[k].pose.pose
            parts = {"scan": seen[k], "stamp": seen[k].header.stamp}
            parts |= {"position": pose.position, "orientation": pose.orientation}
            object.__setattr__(parts[part], name, value)
    topics = {"/scan": ("sensor_msgs/msg/LaserScan", list(enumerate(seen)))}
    return topics | {"/odom": ("nav_msgs/msg/Odometry", list(enumerate(driven)))}


def answers(path, tmp_path, capsys):
    """Ask for a map by each method; what is wrong with the answers."""
    for method in ("scan-graph", "hector", "odometry"):
        code = main(["map", str(path), "-o", str(tmp_path / "map"), "--method", method])
        told = capsys.readouterr().err
        named = told.startswith("slamlab map: ") and path.name in told and told.count("\n") == 1
        fine = not told or (named and "no odometry in" in told) if code == 0 else named
        if code not in (0, 1) or not fine or len(told) > 400:
            yield f"{method}: {code}, {told}"


@pytest.mark.parametrize("accident", ["no wheels", "one wheel", "one scan", "no scan", *ACCIDENTS])
def test_a_bag_of_odd_messages_gives_a_map_or_one_sentence(
    accident, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("slamlab.commands.map.has", lambda name: False)
    few = {"no wheels": {"wheels": 0}, "one wheel": {"wheels": 1}}
    few |= {"one scan": {"scans": 1}, "no scan": {"scans": 0}}
    ros = len(accident) % 2 + 1
    path = tmp_path / ("drive.bag" if ros == 1 else "drive")
    write(path, ros, drive(ros, *ACCIDENTS.get(accident, ()), **few.get(accident, {})))
    assert list(answers(path, tmp_path, capsys)) == []


@pytest.mark.parametrize("ros", [1, 2])
def test_damaged_bytes_of_a_bag_give_a_map_or_one_sentence(
    ros, tmp_path, capsys, monkeypatch, record_property
):
    monkeypatch.setattr("slamlab.commands.map.has", lambda name: False)
    path, rng = tmp_path / ("drive.bag" if ros == 1 else "drive"), damage(ros)
    write(path, ros, drive(ros))
    files = [path] if ros == 1 else sorted(path.iterdir())
    whole = [file.read_bytes() for file in files]
    record_property("files", 24 * ROUNDS)
    for trial in range(24 * ROUNDS):
        k = int(rng.integers(len(files)))
        data = bytearray(whole[k])
        at = int(rng.integers(len(data)))
        if trial % 3 == 0:
            del data[at:]
        elif trial % 3 == 1:
            data[at : at + 8] = rng.bytes(8)
        else:
            del data[at : at + int(rng.integers(1, 200))]
        files[k].write_bytes(data)
        assert list(answers(path, tmp_path, capsys)) == []
        files[k].write_bytes(whole[k])


SCAN, ODOMETRY = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry"


def bag_of(path, ros, moments, *, scan_times=range(1, 11), edit=None, stamped=True):
    """Bag of scans a second apart, and of odometry at these times: 0.2 m/s."""
    store = STORES[ros]
    stamp = (lambda t: t) if stamped else (lambda t: 0.0)
    scans = [(float(t), scan(store, stamp(float(t)), np.ones(5))) for t in scan_times]
    wheels = [(t, odometry(store, stamp(t), [0.2 * t, 0.0, 0.0])) for t in moments]
    if edit:
        edit(scans, wheels)
    write(path, ros, {"/scan": (SCAN, scans), "/odom": (ODOMETRY, wheels)})
    return path


WHERE_IT_STOPS = {
    "ends early": (np.arange(0.0, 5.05, 0.1), [5, 6, 7, 8, 9]),
    "begins late": (np.arange(6.0, 12.0, 0.1), [1, 2, 3, 4, 5]),
    "pauses": (np.r_[np.arange(0.0, 4.05, 0.1), np.arange(6.95, 12.0, 0.1)], [4, 5, 6]),
}


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("case", WHERE_IT_STOPS)
def test_where_odometry_is_missing_the_robot_may_have_done_anything(case, ros, tmp_path):
    moments, blind = WHERE_IT_STOPS[case]
    path = bag_of(tmp_path / ("d.bag" if ros == 1 else "d"), ros, moments)
    with pytest.warns(UserWarning, match=f"no odometry in {len(blind)} of 9 steps"):
        log = read_rosbag(path)
    wide = log.control_cov[:, 0, 0] > 0.03
    assert np.flatnonzero(wide).tolist() == blind
    assert not log.u[wide].any()
    np.testing.assert_allclose(log.u[~wide][1:, 0], 0.2, rtol=1e-6)


def test_clocks_that_share_no_time_are_refused(tmp_path):
    path = bag_of(tmp_path / "d", 2, np.arange(5000.0, 5010.0, 0.1))
    with pytest.raises(ValueError, match="expected scans and odometry of one time"):
        read_rosbag(path)


def test_stamps_that_are_all_zero_give_way_to_the_times_of_recording(tmp_path):
    log = read_rosbag(bag_of(tmp_path / "d", 2, np.arange(0.0, 12.0, 0.1), stamped=False))
    assert log.times.tolist() == list(range(1, 11))
    np.testing.assert_allclose(log.u[1:, 0], 0.2, rtol=1e-6)


@pytest.mark.parametrize("part", ["angle_increment", "range_max", "angle_min"])
def test_a_layout_of_beams_that_changes_is_named(part, tmp_path):
    def edit(scans, wheels):
        setattr(scans[4][1], part, 1.25)

    path = bag_of(tmp_path / "d", 2, np.arange(0.0, 12.0, 0.1), edit=edit)
    with pytest.raises(ValueError, match=f"the scan at 5.000 s: expected {part} .*, got 1.25"):
        read_rosbag(path)


def test_a_quaternion_of_another_length_has_the_heading_it_means(tmp_path):
    def edit(scans, wheels):
        for _, message in wheels:
            turn = message.pose.pose.orientation
            turn.z, turn.w = 0.6, 1.6

    log = read_rosbag(bag_of(tmp_path / "d", 2, np.arange(0.0, 12.0, 0.1), edit=edit))
    heading = 2 * np.arctan2(0.6, 1.6)  # 41.1 degrees, not the 81.7 of the formula for length 1
    np.testing.assert_allclose(np.arctan2(-log.u[1:, 1], log.u[1:, 0]), heading, rtol=1e-6)


def test_a_quaternion_of_zeros_is_named(tmp_path):
    def edit(scans, wheels):
        turn = wheels[7][1].pose.pose.orientation
        turn.z = turn.w = 0.0

    path = bag_of(tmp_path / "d", 2, np.arange(0.0, 12.0, 0.1), edit=edit)
    with pytest.raises(ValueError, match="0.700 s: expected an orientation as a quaternion"):
        read_rosbag(path)
