"""How often an association names the right landmark: precision and recall of a run.

Chapters 11 and 12; any system whose updates report the `ids` they gave, or particles.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from slamlab._checks import as_count, as_instance
from slamlab.evaluation.run import Run

__all__ = ["AssociationScores", "association_scores"]


@dataclass(frozen=True, eq=False)
class AssociationScores:
    """What an association did.

    Attributes
    ----------
    named : int
        Measurements that were paired with a landmark of the map.
    right : int
        Of these, those paired with a landmark that was started by the same true landmark, be it
        the first of its map or a later copy.
    possible : int
        Measurements whose true landmark stood in the map.
    origins : dict
        True landmark by which each landmark of the map was started, -1 for clutter. Of particles
        it is empty: each of them has its own map.
    """

    named: int
    right: int
    possible: int
    origins: dict[Hashable, int]

    @property
    def precision(self) -> float:
        """Share of the pairs made that are right; 1 if none was made."""
        return self.right / self.named if self.named else 1.0

    @property
    def recall(self) -> float:
        """Share of the possible pairs that were made and are right; 1 if none was possible."""
        return self.right / self.possible if self.possible else 1.0


def association_scores(run: Run, known_ids: int = 0, since: int = 0) -> AssociationScores:
    """Count what the association of a run did.

    Parameters
    ----------
    run : Run
        Of a system whose reports have `ids`, over a log with the true ids. Or of particles that
        decide for themselves, every step and their "associations", "is_new" and "ancestors"
        recorded; then the pairs of all particles are counted.
    known_ids : int, default 0
        As in `run`: in the first so many steps the log's ids were handed over, and nothing
        is counted.
    since : int, default 0
        Pairs of earlier steps are not counted either; what they started is remembered.

    Returns
    -------
    AssociationScores

    Examples
    --------
    >>> import numpy as np
    >>> from slamlab.evaluation import run
    >>> from slamlab.robots import Unicycle
    >>> from slamlab.simulation.landmarks import ORCHARD_SENSOR, orchard_loop
    >>> from slamlab.slam import EKFSlam
    >>> from slamlab.slam.association import nearest_neighbour
    >>> log = orchard_loop(np.random.default_rng(1))
    >>> slam = EKFSlam(Unicycle(), ORCHARD_SENSOR, log.truth[0], associate=nearest_neighbour)
    >>> scores = association_scores(run(slam, log, known_ids=False))
    >>> bool(scores.precision > 0.5)
    True
    """
    known_ids, since = as_count("known_ids", known_ids), as_count("since", since)
    as_instance("run", run, Run)
    if run.log.ids is None:
        raise ValueError("run: expected a log with the true ids to compare with, it has none")
    recorded = {"associations", "is_new", "ancestors"} <= set(run.recorded)
    if recorded and len(run.rows) == len(run.log):
        return _of_particles(run, max(known_ids, since))
    origins: dict[Hashable, int] = {}
    named = right = possible = 0
    for k, (truth, report) in enumerate(zip(run.log.ids, run.reports, strict=True)):
        if k < known_ids:
            origins |= {int(one): int(one) for one in truth if one >= 0}
            continue
        if not hasattr(report, "ids"):
            raise ValueError(f"run: expected reports with the ids given, got {report!r:.80}")
        pairs = list(zip(report.ids, truth.tolist(), strict=True))
        known = set(origins.values())
        if k >= since:
            made = [(origins[name], one) for name, one in pairs if name in origins]
            named, right = named + len(made), right + sum(a == b >= 0 for a, b in made)
            possible += sum(one in known for _, one in pairs if one >= 0)
        origins |= {name: one for name, one in pairs if name is not None and name not in origins}
    return AssociationScores(named, right, possible, origins)


def _of_particles(run: Run, since: int) -> AssociationScores:
    """Count the pairs of all particles; each has its own list of what started its columns."""
    kept, named, right, possible = run.recorded, 0, 0, 0
    width = 1 + max(int(associations.max(initial=0)) for associations in kept["associations"])
    # -2: nothing stood in this column yet.
    origins = np.full((len(kept["ancestors"][0]), width), -2)
    for k, truth in enumerate(run.log.ids or ()):
        associations, is_new = kept["associations"][k], kept["is_new"][k]
        here = np.arange(len(origins))[:, None]
        paired = (associations >= 0) & ~is_new
        if k >= since:
            hit = paired & (origins[here, associations] == truth) & (truth >= 0)
            known = (origins[:, :, None] == truth).any(1) & (truth >= 0)
            named, right = named + int(paired.sum()), right + int(hit.sum())
            possible += int(known.sum())
        particle, measurement = np.nonzero(is_new)
        origins[particle, associations[is_new]] = truth[measurement]
        origins = origins[kept["ancestors"][k]]
    return AssociationScores(named, right, possible, {})
