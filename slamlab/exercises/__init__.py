"""Exercise checks, one module a chapter."""

from slamlab.exercises._report import Check, Observation, Report

__all__ = ["Check", "Observation", "Report"]
