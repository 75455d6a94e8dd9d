"""Logs made by machine."""

from slamlab.simulation.drift import drifted

__all__ = ["drifted"]
