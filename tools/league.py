"""The league: every system of the course on the same logs, and the page that shows it.

SLAMLAB_DATA=FOLDER python tools/league.py      (many hours; options as in tools/trials.py)
python tools/league.py --page                   (only the page, from what is stored)

The folder holds the two "corrected" logs of the Radish archive and the relations of Killian Court.
Writes slamlab/datasets/data/league.json and book/league_tables.md.
"""

import os
import pickle
import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from slamlab.datasets import killian, read_carmen
from slamlab.datasets.relations import read_relations
from slamlab.evaluation import ate, relation_error, run
from slamlab.gaussian import mahalanobis_squared
from slamlab.localization import DeadReckoning, LikelihoodField, MonteCarloLocalization
from slamlab.navigation import YOUBOT_BODY, CoveragePilot
from slamlab.robots import YOUBOT, RelativePose
from slamlab.sensors import StereoRig
from slamlab.simulation import (
    ROOM_SENSOR,
    PerfectEstimator,
    drifted,
    ground_laps,
    record,
    room_drives,
)
from slamlab.simulation.expedition import ENVIRONMENTS
from slamlab.slam import (
    CompressedEKFSlam,
    EKFSlam,
    FastSlam,
    GammaSlam,
    GridFastSlam,
    HectorSlam,
    PoseGraph,
    ScanGraphSlam,
    WallSlam,
)
from slamlab.slam.association import joint_compatibility
from slamlab.worlds import Terrain
from tools.trials import Trial, main

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "book" / "league_tables.md"
GATE = 5.991  # 95 % of chi-square with two degrees of freedom
CHAPTERS = {
    "03": "03_extended_kalman_filter",
    "04": "04_particle_filter",
    "05": "05_mecanum_kinematics",
    "09": "09_ekf_slam",
    "10": "10_convergence_consistency_and_cost",
    "11": "11_data_association",
    "12": "12_fastslam",
    "13": "13_pose_graphs",
    "14": "14_scan_matching_and_hector",
    "15": "15_other_maps",
    "16": "16_uav_local_range",
}
# Name: chapter, what it needs, where it fails.
ENTRANTS = {
    "dead reckoning": ("05", "wheels", "always, in the end: the error grows without limit"),
    "EKF-SLAM": ("09", "landmarks with names", "large heading errors; time grows as n^2"),
    "EKF-SLAM, first estimates": ("10", "landmarks with names", "a bad first estimate stays"),
    "EKF-SLAM, nearest neighbour": ("11", "landmarks", "two landmarks inside one gate"),
    "EKF-SLAM, joint compatibility": ("11", "landmarks", "many measurements at once: slow"),
    "compressed EKF-SLAM": ("16", "landmarks with names", "gains only on large maps"),
    "FastSLAM 1.0": ("12", "landmarks with names", "sharp sensors: few particles survive"),
    "FastSLAM 2.0": ("12", "landmarks with names", "forgets the past: overconfident in the end"),
    "landmark graph, all at once": ("13", "named landmarks", "answers only in the end"),
    "Monte Carlo, map given": ("04", "the map, but no start", "two places that look alike"),
    "Hector": ("14", "a lidar, wheels optional", "long loops; fast turns without wheels"),
    "Hector, no wheels": ("14", "a fast lidar alone", "turns of 20 degrees a scan; corridors"),
    "scan matching": ("14", "lidar and wheels", "long loops; plain corridors"),
    "scan graph": ("13", "lidar and wheels", "closures believed too early"),
    "grid FastSLAM": ("15", "lidar and wheels", "a loop longer than its particles remember"),
    "Gamma-SLAM": ("15", "a stereo rig, odometry", "smooth ground; too few particles"),
    "EKF-SLAM, walls": ("09", "straight walls, lidar and wheels", "rooms without long walls"),
}  # fmt: skip
TITLES = {
    "points": "24 landmarks in a room, two rounds, 60 s, simulated",
    "office": "Office of 12 m x 8 m, simulated: lidar of 180 beams, 8 m",
    "ring": "Corridor round a block, 30 m x 20 m, simulated: lidar of 180 beams, 5 m",
    "ground": "Rough ground, two rounds of 63 m in all, simulated: heights from a stereo rig",
    "freiburg-101": "Freiburg, building 101: real scans, odometry made worse",
    "csail": "MIT CSAIL: real scans, odometry made worse",
    "killian": "MIT Killian Court: real scans, scan-matched odometry; no truth: relations decide",
}
GRAPH = "landmark graph, all at once"
SCANS = ("dead reckoning", "Hector", "Hector, no wheels", "scan matching", "scan graph")
ROOMS = (*SCANS, "grid FastSLAM", "EKF-SLAM, walls", "Monte Carlo, map given")
TAKE_PART = {
    "points": (
        *("dead reckoning", "EKF-SLAM", "EKF-SLAM, first estimates", "compressed EKF-SLAM"),
        *("FastSLAM 1.0", "FastSLAM 2.0", "Monte Carlo, map given"),
        *("EKF-SLAM, nearest neighbour", "EKF-SLAM, joint compatibility", GRAPH),
    ),
    "office": ROOMS,
    "ring": ROOMS,
    "ground": ("dead reckoning", "Gamma-SLAM"),
    "freiburg-101": (*SCANS, "grid FastSLAM"),
    "csail": (*SCANS, "grid FastSLAM"),
    "killian": SCANS,
}
N_DRIVES = 20
DRIVES = range(1, N_DRIVES + 1)
SEEDS = {"points": range(N_DRIVES)} | dict.fromkeys(
    ("office", "ring", "ground", "freiburg-101", "csail"), DRIVES
)  # Killian: one drive
PEERS = {"points": "EKF-SLAM", "ground": "dead reckoning"}  # whose time is 1; else scan matching


# Logs and who takes part.


@cache
def room():
    return room_drives(N_DRIVES, np.random.default_rng([0, 20]), start_cov=None)


@cache
def toured(building, seed, max_time=400.0):
    """Drive round a building with a robot that knows where it is: the estimators do not."""
    place, rng = ENVIRONMENTS[building], np.random.default_rng(19 + seed)
    pilot = CoveragePilot(
        YOUBOT_BODY, place.lidar, view_range=place.view_range, max_speed=0.6, max_turn=1.0
    )
    return record(
        place.world(), YOUBOT, place.lidar, pilot, PerfectEstimator(), rng,
        start=place.start, dt=0.2, control_cov=YOUBOT.control_cov(0.4),
        footprint=YOUBOT_BODY.footprint, max_time=max_time,
    )  # fmt: skip


@cache
def ground(seed):
    rng = np.random.default_rng(seed)
    return ground_laps(Terrain.rough(rng, (22, 22), spread=0.9), StereoRig(3000), rng, radius=5.0)


@cache
def real(name, seed):
    if name == "killian":
        return killian().log
    folder = Path(os.environ["SLAMLAB_DATA"])
    whole = read_carmen(folder / f"{name}-corrected.log.gz", corrected=True)
    return drifted(whole, np.random.default_rng(seed))


def landmark_systems(log, seed):
    pose, motion, rng = log.truth[0], YOUBOT, np.random.default_rng(seed)
    return {
        "dead reckoning": DeadReckoning(motion, pose),
        "EKF-SLAM": EKFSlam(motion, ROOM_SENSOR, pose),
        "EKF-SLAM, first estimates": EKFSlam(
            motion, ROOM_SENSOR, pose, linearisation="first-estimates"
        ),
        "compressed EKF-SLAM": CompressedEKFSlam(motion, ROOM_SENSOR, pose, radius=4.0),
        "FastSLAM 1.0": FastSlam(motion, ROOM_SENSOR, pose, 100, 1, rng=rng),
        "FastSLAM 2.0": FastSlam(motion, ROOM_SENSOR, pose, 100, 2, rng=rng),
        "Monte Carlo, map given": MonteCarloLocalization(
            log.landmarks, motion, ROOM_SENSOR, 1000, [[-6.0, 6.0], [-5.0, 5.0]], rng
        ),
        "EKF-SLAM, nearest neighbour": EKFSlam(motion, ROOM_SENSOR, pose),
        "EKF-SLAM, joint compatibility": EKFSlam(
            motion, ROOM_SENSOR, pose, associate=joint_compatibility
        ),
    }


def scan_systems(log, name, seed):
    pose, lidar, rng = log.truth[0], log.scan, np.random.default_rng(seed)
    motion = YOUBOT if name in ENVIRONMENTS else RelativePose()
    if name == "ground":
        return {
            "dead reckoning": DeadReckoning(motion, pose),
            "Gamma-SLAM": GammaSlam(lidar, pose, 40, rng=rng),
        }
    systems = {
        "dead reckoning": DeadReckoning(motion, pose),
        "Hector": HectorSlam(lidar, pose, motion=motion),
        "Hector, no wheels": HectorSlam(lidar, pose, motion=None),
        "scan matching": ScanGraphSlam(lidar, pose, motion=motion, loops=False),
        "scan graph": ScanGraphSlam(lidar, pose, motion=motion),
    }
    if name != "killian":
        systems["grid FastSLAM"] = GridFastSlam(lidar, pose, 30, rng=rng, motion=motion)
    if name in ENVIRONMENTS:
        place = ENVIRONMENTS[name]
        world = place.world()
        systems["EKF-SLAM, walls"] = WallSlam(motion, place.lidar, pose)
        field = LikelihoodField(world.occupied, world.resolution, world.origin, n_points=30)
        low_x, low_y, high_x, high_y = world.bounds
        systems["Monte Carlo, map given"] = MonteCarloLocalization(
            field, motion, lidar, 3000, [[low_x, high_x], [low_y, high_y]], rng
        )
    return systems


# Judging.


def judged(result):
    """Accuracy, honesty, time and memory of a run."""
    off = result.poses[:, :2] - result.truth[:, :2]
    covs = result.covs[:, :2, :2] + 1e-12 * np.eye(2)
    claims = np.trace(covs, axis1=1, axis2=2) > 1e-9
    inside = mahalanobis_squared(off[claims], covs[claims]) < GATE
    return {
        "error": ate(result).rmse,
        "covered": float(inside.mean()) if claims.any() else None,
        "seconds": float(np.median(result.seconds[1:])),
        "bytes": len(pickle.dumps(result.system)),
    }


def landmark_row(system, seed):
    log = room().single(seed)
    if system == GRAPH:
        graph = PoseGraph.from_log(log, YOUBOT, ROOM_SENSOR, log.truth[0])
        error = ate(graph.optimize().poses, log.truth).rmse
        return {"error": error, "covered": None, "seconds": None, "bytes": None}
    told = system not in ("EKF-SLAM, nearest neighbour", "EKF-SLAM, joint compatibility")
    return judged(run(landmark_systems(log, seed)[system], log, known_ids=told))


def scan_row(name, system, seed):
    if name == "ground":
        log = ground(seed)
    else:
        log = toured(name, seed) if name in ENVIRONMENTS else real(name, seed)
    result = run(scan_systems(log, name, seed)[system], log)
    row = judged(result)
    if name == "killian":
        relations = read_relations(Path(os.environ["SLAMLAB_DATA"]) / "mit-killian.relations.gz")
        error = relation_error(killian().timestamps, result.trajectory, relations)
        row["relations"] = float(error.translation.mean())
    return row


def one(name, system, seed):
    """One system on one drive: error (m), share inside, seconds a step, bytes."""
    row = landmark_row(system, seed) if name == "points" else scan_row(name, system, seed)
    return {key: rounded(value, 4) for key, value in row.items()}


# The page.


def rounded(value, digits):
    return None if value is None else float(f"{value:.{digits}g}")


def short(metres):
    return f"{metres:.2g}" if metres < 1 else f"{metres:.1f}"


def spread(values, form):
    """Least to most, in brackets; nothing for one value."""
    return f" ({form(min(values))} to {form(max(values))})" if len(values) > 1 else ""


def middle(runs):
    """Medians of runs; of the seconds the lower quartile: other programs disturbed some runs."""
    return {
        key: None
        if runs[0][key] is None
        else float(np.quantile([run[key] for run in runs], 0.25 if key == "seconds" else 0.5))
        for key in runs[0]
    }


def table(name, stored):
    """One Markdown table, the most accurate first; of several drives medians, least to most."""
    rows = {system: middle(runs) for system, runs in stored.items()}
    peer = PEERS.get(name, "scan matching")
    base, measure = rows[peer]["seconds"], "relations" if name == "killian" else "error"
    head = ["system", "error (m)", "inside its 95 % ellipse", f"time a step, {peer} = 1",
            "memory (kB)", "needs", "fails at"]  # fmt: skip
    if name == "killian":
        head[1] = "error of relations (m)"
    lines = ["| " + " | ".join(head) + " |", "|---|---:|---:|---:|---:|---|---|"]
    for system in sorted(rows, key=lambda one: rows[one][measure]):
        row, (chapter, needs, fails) = rows[system], ENTRANTS[system]
        errors, shares = ([run[key] for run in stored[system]] for key in (measure, "covered"))
        covered, seconds, size = row["covered"], row["seconds"], row["bytes"]
        file = f"../notebooks/{CHAPTERS[chapter]}.ipynb"
        label = f"[{system}]({file})" if (ROOT / "book" / file).resolve().exists() else system
        cells = [
            label,
            short(row[measure]) + spread(errors, short),
            "claims none"
            if covered is None
            else f"{covered:.0%}" + spread(shares, "{:.0%}".format),
            "" if seconds is None else f"{rounded(seconds / base, 1):g}",
            "" if size is None else f"{rounded(size / 1000, 2):g}",
            needs,
            fails,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    n = len(stored[peer])
    title = TITLES[name] + (f": median of {n} drives" if n > 1 else "")
    return "\n".join([f"## {title}", "", ":::{container} sortable", *lines, ":::", ""])


def page(stored):
    return "\n".join(table(name, stored[name]) for name in TITLES if name in stored)


def write_page():
    PAGE.write_text(page(TRIAL.read()))


TRIAL = Trial(
    "league",
    {
        (name, system): SEEDS.get(name, (1,))
        for name, systems in TAKE_PART.items()
        for system in systems
    },
    one,
    sample=(("points", "EKF-SLAM", 0), ("points", "FastSLAM 1.0", 13)),
    off=1e-4,
    needs_data=("freiburg-101", "csail", "killian"),
    machine=("seconds", "bytes"),
    finish=write_page,
)

if __name__ == "__main__":
    if sys.argv[1:] == ["--page"]:
        write_page()
    else:
        sys.exit(main(TRIAL))
