"""Exercise checks, one module a chapter; the labs; experiments that one page shows."""

from slamlab.exercises._report import Check, Observation, Report

__all__ = ["Check", "Observation", "Report"]
