"""The league: a page that shows what is stored, every entrant explained."""

import numpy as np

from tools import league

STORED = league.TRIAL.read()


def test_the_page_shows_what_is_stored():
    assert league.PAGE.read_text() == league.page(STORED)


def test_every_entrant_is_explained_and_every_log_has_a_title():
    assert set(STORED) == set(league.TITLES)
    for name, rows in STORED.items():
        assert set(rows) <= set(league.ENTRANTS)
        assert league.PEERS.get(name, "scan matching") in rows


def test_the_most_accurate_stands_first():
    lines = [line for line in league.table("csail", STORED["csail"]).split("\n") if "|" in line]
    errors = [float(line.split("|")[2].split("(")[0]) for line in lines[2:]]
    assert errors == sorted(errors)


def test_a_row_of_several_drives_shows_its_median_and_least_to_most():
    runs = [{"error": e, "covered": None, "seconds": 10 * e} for e in (0.1, 0.5, 0.2)]
    assert league.middle(runs) == {"error": 0.2, "covered": None, "seconds": 1.5}
    assert league.spread([0.1, 0.5, 0.2], league.short) == " (0.1 to 0.5)"
    assert league.spread([0.1], league.short) == ""
    errors = [run["error"] for run in STORED["points"]["EKF-SLAM"]]
    line = next(
        line
        for line in league.table("points", STORED["points"]).split("\n")
        if "[EKF-SLAM]" in line
    )
    assert f"{np.median(errors):.2g} ({min(errors):.2g} to {max(errors):.2g})" in line
