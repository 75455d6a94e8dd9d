"""Exercise checks, one module a chapter."""

from slamlab.exercises._report import Mistake, Property, Report, run_cases, run_checks

__all__ = ["Mistake", "Property", "Report", "run_cases", "run_checks"]
