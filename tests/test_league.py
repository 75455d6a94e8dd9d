"""The league: one row made again, a page that shows what is stored, every entrant explained."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SPEC = importlib.util.spec_from_file_location("league", ROOT / "tools" / "league.py")
league = importlib.util.module_from_spec(SPEC)
sys.modules["league"] = league
SPEC.loader.exec_module(league)
STORED = json.loads(league.STORED.read_text())


def test_a_stored_row_can_be_had_again():
    row = league.rows_of("points", only="EKF-SLAM")["EKF-SLAM"]
    stored = STORED["points"]["EKF-SLAM"]
    assert row["error"] == pytest.approx(stored["error"], rel=0.01)
    assert row["covered"] == pytest.approx(stored["covered"], abs=0.01)


def test_the_page_shows_what_is_stored():
    assert league.PAGE.read_text() == league.page(STORED)


def test_every_entrant_is_explained_and_every_log_has_a_title():
    assert set(STORED) == set(league.TITLES)
    for name, rows in STORED.items():
        assert set(rows) <= set(league.ENTRANTS)
        assert league.PEERS.get(name, "scan matching") in rows


def test_the_most_accurate_stands_first():
    lines = [line for line in league.table("csail", STORED["csail"]).split("\n") if "|" in line]
    errors = [float(line.split("|")[2]) for line in lines[2:]]
    assert errors == sorted(errors)
