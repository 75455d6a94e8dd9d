"""A robot in a world, driven by a pilot who knows what the robot believes: out comes a log."""

from slamlab.simulation.drift import drifted
from slamlab.simulation.record import Script, Truth, record

__all__ = ["Script", "Truth", "drifted", "record"]
