"""Tables of the lessons over many seeds: the stored runs of their own functions.

python tools/lesson_tables.py     (some forty minutes; options as in tools/trials.py)

A page says what its runs are called and makes one of them by name and seed; nothing of the
experiment is written here. Writes slamlab/datasets/data/lesson_tables.json, which
`slamlab.datasets.stored_runs` reads.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.trials import Trial, main, of_page

DIVERGED = 1e6  # a larger number says no more


@dataclass(frozen=True)
class Table:
    """The page, the function that makes a run, what lists the runs' names, and their seeds."""

    page: str
    function: str
    names: str
    seeds: Sequence[int]
    constants: tuple[str, ...] = ()


# Of each page, the names in small letters that its function needs.
COURT = ("court", "graph", "dead_reckoned", "reference")
EKF_SLAM = ("sets", "log", "V")
EXPEDITION = ("world", "lidar", "near", "guard")
EXPLORATION = ("robot", "lidar", "room", "clearance", "contest")
FREE_RUNS = (*EXPLORATION, "starts", "once", "surface", "wall_pixels")
FAST_SLAM = ("motion", "floor", "dull", "sharp")
FIELD = ("motion", "sensor", "r")
GAMMA_SLAM = ("motion", "rig", "side", "wide")
HALL = ("motion", "sensor", "pillars", "hall", "sigmas", "V")
ICP = ("office", "lidar", "here")
RETURNS = ("methods",)
SCANS = ("room", "lidar", "step", "atlas", "pitch", "hall", "hall_atlas")
SLOPE = ("office", "lidar", "slip", "released_slope")
WALLS = ("sigma", "room", "lidar", "sensor", "truth", "exact")
WALL_SLAM = (
    *("room", "lidar", "drive", "clean", "exact"),
    *("full", "parts", "starts", "steps", "steps_cov"),
)
WAY_BACK = ("E", "leg", "start", "truth", "room", "camera", "light", "steps", "believed", "points")
WAY_BACK += ("start_home", "F", "whole")
WAY_NOISE = ("leg", "bend", "truth", "rng", "camera", "believed", "whole", "light", "v", "w")
WAY_NOISE += ("memory", "strategies", "true_steps")
WAY_HOME = ("E", "leg", "start", "truth", "room", "camera", "light", "drives", "calm")
TABLES = {
    "00 closures": Table("00_slam_in_ten_minutes", "with_closures", "COUNTS", range(25), COURT),
    "00 mistakes": Table("00_slam_in_ten_minutes", "with_mistake", "MISTAKES", range(40)),
    "00 starts": Table("00_slam_in_ten_minutes", "poor_start", "TURNED", range(20), COURT),
    "04 awakenings": Table("04_particle_filter", "awakened", "CLOUDS", range(100), HALL),
    "04 mistakes": Table("04_particle_filter", "with_mistake", "MISTAKES", range(100), HALL),
    "04b injection": Table("04b_particle_filter", "injected", "INJECTION", range(100), HALL),
    "07 mistakes": Table("07_walls_from_points", "with_mistake", "MISTAKES", range(20), WALLS),
    "07b assigned": Table("07b_walls_from_points", "assigned", "POSES", range(20), WALLS),
    "09 mistakes": Table("09_ekf_slam", "with_mistake", "MISTAKES", range(5, 25), EKF_SLAM),
    "09b noise": Table("09b_ekf_slam", "driven_again", "EVERY", range(20), WALL_SLAM),
    "09b odometry": Table("09b_ekf_slam", "drawn_anew", "DRAWN", range(20), WALL_SLAM),
    "09b rooms": Table("09b_ekf_slam", "in_room", "ROOMS", range(20), WALL_SLAM),
    "11 mistakes": Table("11_data_association", "with_mistake", "MISTAKES", range(20)),
    "11b clutter": Table("11b_data_association", "with_clutter", "CLUTTER", range(20), RETURNS),
    "11b confirmed": Table("11b_data_association", "confirmed", "ADDED", range(1, 21), RETURNS),
    "12 mistakes": Table("12_fastslam", "with_mistake", "MISTAKES", range(1, 21), FAST_SLAM),
    "12 noise given": Table("12_fastslam", "with_noise", "GIVEN", range(100), FAST_SLAM),
    "12 rounds": Table("12_fastslam", "two_rounds", "ROUNDS", range(20), FAST_SLAM),
    "12 sensors": Table("12_fastslam", "with_sensor", "ASKED", range(1, 21), FAST_SLAM),
    "13 kernels": Table("13_pose_graphs", "rejected", "RECIPES", range(20)),
    "13 mistakes": Table("13_pose_graphs", "with_mistake", "MISTAKES", range(40), ("sigma",)),
    "14 alone": Table("14_scan_matching_and_hector", "without_wheels", "ALONE", range(1, 21), ICP),
    "14 mistakes": Table(
        "14_scan_matching_and_hector", "with_mistake", "MISTAKES", range(20), ICP
    ),
    "14 slopes": Table("14_scan_matching_and_hector", "with_slopes", "SLOPES", range(1, 21), ICP),
    "14b turned": Table("14b_scan_matching_and_hector", "turned", "ANGLES", range(1, 21), SLOPE),
    "15 grounds": Table("15_other_maps", "on_ground", "GROUNDS", range(1, 21), GAMMA_SLAM),
    "15 mistakes": Table("15_other_maps", "with_mistake", "MISTAKES", range(1, 21), GAMMA_SLAM),
    "15 powers": Table("15_other_maps", "with_power", "POWERS", range(1, 21), GAMMA_SLAM),
    "15d clouds": Table("15d_other_maps", "cloud", "KINDS", range(1, 21)),
    "16 cameras": Table("16_uav_local_range", "with_camera", "CAMERAS", range(1, 21), FIELD),
    "16 changes": Table("16_uav_local_range", "with_change", "CHANGES", range(1, 21), FIELD),
    "17 mistakes": Table("17_the_way_home", "with_mistake", "MISTAKES", range(20), WAY_HOME),
    "17 returns": Table("17_the_way_home", "at_home", "RETURNS", range(40), WAY_BACK),
    "17c drives": Table("17c_the_way_home", "camera_drive", "DRIVES", range(40), WAY_NOISE),
    "17c pairs": Table("17c_the_way_home", "fitted", "PAIRS", range(2, 22), WAY_NOISE),
    "17c returns": Table("17c_the_way_home", "returned", "RETURNS", range(20), WAY_NOISE),
    "18 contest": Table("18_exploration", "toured", "RUNS", range(20), EXPLORATION),
    "18 mistakes": Table("18_exploration", "with_mistake", "MISTAKES", range(20), EXPLORATION),
    "18b guards": Table("18b_exploration", "guarded", "GUARDS", range(20), FREE_RUNS),
    "18b parts": Table("18b_exploration", "part_of_beam", "PARTS", range(120), FREE_RUNS),
    "18b rooms": Table("18b_exploration", "job_of", "WORK", range(20), FREE_RUNS),
    "18b stacks": Table("18b_exploration", "by_stack", "RULES", range(120), FREE_RUNS),
    "19 mistakes": Table(
        "19_autocorrelation_localization", "with_mistake", "MISTAKES", range(1, 21), SCANS
    ),
    "20 ways home": Table("20_explore_and_return", "all_ways", "TRIPS", range(20), EXPEDITION),
}


once = cache(of_page)  # tables of a page that need the same constants share it


def page(table: str) -> dict:
    """Give the functions of a table's page."""
    return once(TABLES[table].page, *TABLES[table].constants)


def one(table: str, name: str, seed: int) -> dict:
    """Make a run as its page does: numbers, or lists of numbers, with four digits."""
    run = page(table)[TABLES[table].function](name, seed)

    def short(value: object) -> object:
        if isinstance(value, list):
            return [short(each) for each in value]
        return float(f"{min(float(value), DIVERGED):.4g}")

    return {key: short(value) for key, value in run.items()}


TRIAL = Trial(
    "lesson_tables",
    {(table, name): how.seeds for table, how in TABLES.items() for name in page(table)[how.names]},
    one,
    sample=(
        ("00 closures", "10", 3),
        ("00 mistakes", "D  Ω ten times too large", 3),
        ("00 starts", "0.2", 2),
        ("04 awakenings", "8000", 3),
        ("04 mistakes", "C  weights kept", 1),
        ("04b injection", "with, kidnapped", 2),
        ("07 mistakes", "C  cut in the middle", 4),
        ("07b assigned", "150 poses", 6),
        ("09 mistakes", "D  no lever arm in H", 6),
        ("09b noise", "a sixth of the scans", 7),
        ("09b odometry", "part 8", 3),
        ("09b rooms", "boxes drawn by the seed", 4),
        ("11 mistakes", "3  gate of one pair", 2),
        ("11b clutter", "4: nearest neighbour", 3),
        ("11b confirmed", "at the third", 2),
        ("12 mistakes", "2  weight with R alone", 2),
        ("12 noise given", "100, noise 0.25", 1),
        ("12 rounds", "30", 2),
        ("12 sensors", "sharp: 10 of 2.0", 2),
        ("13 kernels", "k = 3, headings first", 1),
        ("13 mistakes", "1  Ω in the frame of pose i", 2),
        ("14 alone", "18°, four maps", 3),
        ("14 mistakes", "error not projected", 1),
        ("14 slopes", "Hector as written", 2),
        ("14b turned", "30°", 2),
        ("15 grounds", "cells across patches", 3),
        ("15 mistakes", "4  density of variances", 2),
        ("15 powers", "0.1", 4),
        ("15d clouds", "30 that match", 2),
        ("16 cameras", "20", 3),
        ("16 changes", "no theta", 2),
        ("17 mistakes", "B  begins halfway", 1),
        ("17 returns", "0.7 w", 1),
        ("17c drives", "each picture serves twice", 1),
        ("17c pairs", "20 matches, none wrong", 3),
        ("17c returns", "pursuit, tail first", 2),
        ("18 contest", "first room: information gain", 3),
        ("18 mistakes", "4  only where beams end", 11),
        ("18b guards", "6, 1 mm of room", 13),
        ("18b parts", "0.75", 21),
        ("18b rooms", "office, 60% in 18 m: nearest frontier", 4),
        ("18b stacks", "quarters: turns to its own beams", 25),
        ("19 mistakes", "2  no cap", 2),
        ("20 ways home", "worn wheels", 6),
    ),
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
