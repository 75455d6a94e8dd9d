"""Checks of chapter 12: the weight of a landmark, the proposal of 2.0, copies, ancestors.

P2 (15) is the weight, (18) the proposal; copies and ancestors are its step 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamlab.exercises._draw import a_covariance, a_pose, drawn
from slamlab.exercises._report import Array, Check, Function, Ints
from slamlab.geometry import wrap_angle

__all__ = ["check_ancestors", "check_copies", "check_look", "check_proposal", "check_weight"]


# Exercise 1: the weight of a landmark.


def _log_weight(y: Array, H: Array, S: Array, R: Array) -> float:
    """Logarithm of (15): innovation y (2,), landmark covariance S, Jacobian H, sensor noise R."""
    Z = H @ S @ H.T + R
    quadratic = y @ np.linalg.solve(Z, y)
    return float(-0.5 * quadratic - 0.5 * np.log(np.linalg.det(Z)) - np.log(2 * np.pi))


@drawn
def _seen(rng: np.random.Generator, doubt: float) -> Any:
    y, H = np.round(rng.normal(0, 0.4, 2), 2), np.round(rng.normal(0, 1, (2, 2)), 2)
    return y, H, doubt * a_covariance(rng, 2, 0.3), a_covariance(rng, 2, 0.05)


_DETERMINANT = " - 0.5 * np.log(np.linalg.det(Z))"

check_weight = Check(
    _log_weight,
    "log weight",
    {
        "a tree seen from the side": _seen(1.0),
        "a tree that is almost known": _seen(0.01),
        "a tree that is known exactly": _seen(0.0),
        "no innovation at all": lambda rng: (np.zeros(2), *_seen(1.0)(rng)[1:]),
        "a surprise": lambda rng: (np.array([2.5, -1.5]), *_seen(1.0)(rng)[1:]),
        "a surprise whose density underflows": lambda rng: (
            np.array([60.0, -50.0]),
            *_seen(0.1)(rng)[1:],
        ),
    },
    {
        "R alone: the landmark is uncertain too, add H S H^T": "H @ S @ H.T + R => R",
        "S and R live in different spaces: turn S by H before they are added": (
            "H @ S @ H.T + R => S + R"
        ),
        "this is H^T S H: the Jacobian stands the other way round": "H @ S @ H.T => H.T @ S @ H",
        "the second H is not transposed: H S H^T": "@ H.T => @ H",
        "R is missing: the sensor has noise too": " + R => ",
        "R counts twice": "+ R => + 2 * R",
        "R is a covariance already: it is not squared": "+ R => + R @ R",
        "the determinant is missing: it tells an uncertain landmark from a certain one": (
            f"{_DETERMINANT} => "
        ),
        "the root of the determinant is due: its logarithm counts half": (
            f"{_DETERMINANT} =>  - np.log(np.linalg.det(Z))"
        ),
        "the determinant has the wrong sign: an uncertain landmark spreads its likelihood": (
            f"{_DETERMINANT} =>  + 0.5 * np.log(np.linalg.det(Z))"
        ),
        "the 2 pi is missing: new landmarks and known ones are compared by their likelihood": (
            " - np.log(2 * np.pi) => "
        ),
        "the 2 pi stands there for one dimension: two numbers were measured": (
            "- np.log(2 * np.pi) => - 0.5 * np.log(2 * np.pi)"
        ),
        "this is the density: its logarithm is due": lambda *given: np.exp(_log_weight(*given)),
        "this is the logarithm of the density after it underflowed": (
            lambda *given: np.log(np.exp(_log_weight(*given)))
        ),
        "one half is missing in front of the quadratic form": "-0.5 * quadratic => -quadratic",
        "Z was multiplied, not inverted": "np.linalg.solve(Z, y) => Z @ y",
        "the sign is turned: a large innovation makes a small weight": (
            lambda *given: -_log_weight(*given)
        ),
        "the distance alone came: (15) is a likelihood": lambda y, H, S, R: (
            y @ np.linalg.solve(H @ S @ H.T + R, y)
        ),
    },
    tolerance=1e-8,
)


# Exercise 2: look before you draw.


def _proposal(x: Array, Q: Array, H: Array, Z: Array, y: Array) -> tuple[Any, Any]:
    """Mean and covariance of (18): predicted pose x (3,), its noise Q, innovation y with cov Z."""
    W = np.linalg.inv(Z)
    P = np.linalg.inv(np.linalg.inv(Q) + H.T @ W @ H)
    return x + P @ H.T @ W @ y, P


@drawn
def _odometry(rng: np.random.Generator, noise: float, surprise: float = 1.0) -> Any:
    x, y, H = (np.round(rng.normal(0, 1, shape), 2) for shape in (3, 2, (2, 3)))
    return x, a_covariance(rng, 3, 0.1), H, a_covariance(rng, 2, noise), surprise * y


check_proposal = Check(
    _proposal,
    "mean, cov",
    {
        "measurement and odometry disagree": _odometry(0.05),
        "no innovation: only the covariance shrinks": _odometry(0.05, 0.0),
        "a dull sensor changes little": _odometry(20.0),
        "a sharp sensor": _odometry(0.002),
    },
    {
        "this is the motion model, version 1.0: the measurement was not used": (
            lambda x, Q, H, Z, y: (x.copy(), Q.copy())
        ),
        "the covariance shrinks, but the mean must move too": "x + P @ H.T @ W @ y => x.copy()",
        "the mean moves the wrong way: y is the measurement minus its prediction": (
            "x + P => x - P"
        ),
        "this is the information matrix: invert it": "W @ y, P => W @ y, np.linalg.inv(P)",
        "the pull uses Q: it must be the new covariance P": "x + P => x + Q",
        "Z must be inverted: a noisy measurement pulls less": "W = np.linalg.inv(Z) => W = Z",
        "Z is missing: its inverse weighs the measurement": (
            "W = np.linalg.inv(Z) => W = np.eye(2)"
        ),
        "Z is missing in the mean: its inverse weighs the innovation": "H.T @ W @ y => H.T @ y",
        "Q must be inverted: what each source knows adds up": "np.linalg.inv(Q) + => Q +",
        "Q was left out: odometry and measurement speak together": (
            "np.linalg.inv(np.linalg.inv(Q) + H.T @ W @ H) => np.linalg.pinv(H.T @ W @ H)"
        ),
        "covariances were added: their inverses add up": (
            "np.linalg.inv(np.linalg.inv(Q) + H.T @ W @ H) => Q + H.T @ Z @ H"
        ),
        "the step alone came: add it to x": "x + P @ H => P @ H",
    },
    tolerance=1e-8,
)


# Exercise 3: copies that stay apart.


def _copy_particles(maps: list[Array], chosen: Ints) -> list[Array]:
    """Return maps of which entry i is a copy of ``maps[chosen[i]]`` that may change alone."""
    return [maps[i].copy() for i in chosen]


def _written(copy: Function, maps: list[Array], chosen: Ints) -> Any:
    """Copy, then let every particle write its number into its first landmark."""
    kept = [one.copy() for one in maps]
    after = list(copy(kept, chosen))
    for number, one in enumerate(after):
        one[0] = number
    return np.array(after), np.array(kept)


def _shared(maps: list[Array], chosen: Ints) -> list[Array]:
    """Copy each chosen particle once only."""
    fresh = {int(i): maps[i].copy() for i in chosen}
    return [fresh[int(i)] for i in chosen]


def _counts(maps: list[Array], chosen: Ints) -> list[Array]:
    new = [m.copy() for m, n in zip(maps, chosen, strict=True) for _ in range(int(n))]
    return (new + [m.copy() for m in maps])[: len(chosen)]


def _resampled(rng: np.random.Generator) -> Any:
    m, n = rng.integers(2, 7, 2)
    return list(np.round(rng.normal(0, 5, (m, n, 2)), 1)), rng.integers(0, m, m)


_MAPS = list(10.0 * np.arange(1, 5)[:, None, None] + np.arange(4).reshape(2, 2))

check_copies = Check(
    _copy_particles,
    "new maps, old maps",
    {
        "one particle survives twice, one dies": (_MAPS, [0, 1, 1, 3]),
        "one particle survives alone": (_MAPS, [2, 2, 2, 2]),
        "everybody survives, in another order": (_MAPS, [3, 0, 1, 2]),
        "a single particle": (_MAPS[:1], [0]),
        "any draw": _resampled,
    },
    {
        "nothing was copied: these are the old arrays, and copies of one particle are one array": (
            "maps[i].copy() => maps[i]"
        ),
        "copies of the same particle share one array: each needs its own": _shared,
        "the first copy of each particle is the old array itself: copy that one too": (
            lambda maps, chosen: [
                maps[i] if i not in list(chosen[:k]) else maps[i].copy()
                for k, i in enumerate(chosen)
            ]
        ),
        "the particles are still the old ones: take those that were chosen": (
            lambda maps, chosen: [m.copy() for m in maps]
        ),
        "`chosen` holds indices, not numbers of copies": _counts,
        "each chosen particle came once: one chosen twice must come twice": (
            "for i in chosen => for i in sorted(set(chosen.tolist()))"
        ),
        "the order is lost: copy number i comes from particle chosen[i]": (
            "for i in chosen => for i in chosen[::-1]"
        ),
        "the copies were sorted: copy number i comes from particle chosen[i]": (
            "for i in chosen => for i in sorted(chosen)"
        ),
        "the old maps were overwritten: the new set is made of new arrays": (
            lambda maps, chosen: _overwritten(maps, chosen)
        ),
        "counted from one: particle 0 is the first": "maps[i] => maps[i - 1]",
    },
    use=_written,
)


def _overwritten(maps: list[Array], chosen: Ints) -> list[Array]:
    new = [maps[i].copy() for i in chosen]
    for old, one in zip(maps, new, strict=True):
        old[...] = one
    return new


# Exercise 4: how many ancestors live on?


def _distinct_ancestors(parents: Ints) -> Ints:
    """Particles (T,) of each step with a descendant at the end; parents (T, M) as indices.

    ``parents[t, i]`` is the row, before resampling t, of what is row i after it.
    """
    rows, counts = np.arange(parents.shape[1]), []
    for one in parents[::-1]:
        rows = one[rows]
        counts.append(len(np.unique(rows)))
    return np.array(counts[::-1], dtype=int)


def _history(rng: np.random.Generator) -> Any:
    steps, m = rng.integers(1, 9), rng.integers(2, 30)
    return (np.sort(rng.integers(0, m, (steps, m)), axis=1),)


check_ancestors = Check(
    _distinct_ancestors,
    "counts",
    {
        "nobody ever dies": (np.tile(np.arange(4), (3, 1)),),
        "two steps": ([[0, 0, 1, 3], [1, 2, 2, 3]],),
        "one particle takes all in the middle": ([[0, 1, 2, 3], [2, 2, 2, 2], [0, 1, 1, 3]],),
        "a single resampling": ([[1, 1, 2]],),
        "not sorted": lambda rng: (rng.integers(0, 6, (4, 6)),),
        "any history": _history,
    },
    {
        "each resampling was counted alone: follow the lines through all later ones": (
            lambda parents: np.array([len(np.unique(one)) for one in parents])
        ),
        "this counts living lines of the first step: walk back from the end": (
            "in parents[::-1] => in parents",
            "rows = one[rows] => rows = rows[one]",
            "counts[::-1] => counts",
        ),
        "composed the wrong way round: the parent of row i is parents[t][i]": (
            "one[rows] => rows[one]"
        ),
        "off by one step: resampling t is counted before it is followed": (
            lambda parents: np.append(_distinct_ancestors(parents)[1:], parents.shape[1])
        ),
        "the steps came in reverse order": "counts[::-1] => counts",
        "these are shares: the numbers themselves are due": (
            lambda parents: _distinct_ancestors(parents) / parents.shape[1]
        ),
        "one number came: each resampling has its own": (
            lambda parents: _distinct_ancestors(parents)[0]
        ),
        "this is the running minimum of the single counts, which only bounds the living lines": (
            lambda parents: np.minimum.accumulate([len(np.unique(p)) for p in parents[::-1]])[::-1]
        ),
        "this counts those without descendants": (
            lambda parents: parents.shape[1] - _distinct_ancestors(parents)
        ),
    },
)


# Exercise 5: one reading of one landmark, for all particles.


def _look(
    poses: Array, weights: Array, means: Array, covs: Array, z: Array, R: Array
) -> tuple[Array, Array, Array]:
    """Weights (M,), means (M, 2) and covariances (M, 2, 2) after range and bearing z (2,)."""
    d = means - poses[:, :2]
    squared = np.sum(d**2, axis=1)
    rho = np.sqrt(squared)
    H = np.array([[d[:, 0] / rho, d[:, 1] / rho], [-d[:, 1] / squared, d[:, 0] / squared]])
    H = H.transpose(2, 0, 1)
    bearing = np.arctan2(d[:, 1], d[:, 0]) - poses[:, 2]
    v = np.stack([z[0] - rho, wrap_angle(z[1] - bearing)], -1)
    S = H @ covs @ H.transpose(0, 2, 1) + R
    W = np.linalg.inv(S)
    K = covs @ H.transpose(0, 2, 1) @ W
    log = -0.5 * np.einsum("mi,mij,mj->m", v, W, v) - 0.5 * np.log(np.linalg.det(S))
    new = weights * np.exp(log - log.max())
    return (
        new / new.sum(),
        means + np.einsum("mij,mj->mi", K, v),
        covs - K @ S @ K.transpose(0, 2, 1),
    )


@drawn
def _particles(rng: np.random.Generator, n: int, alike: bool = False, behind: bool = False) -> Any:
    poses = np.array([a_pose(rng, 1.0) for _ in range(n)])
    poses[:, 2] = rng.normal(3.0 if behind else 0.3, 0.1, n)
    means = poses[:, :2] + np.round(rng.normal([-4.0 if behind else 4.0, -0.5], 0.5, (n, 2)), 2)
    covs = np.array(
        [a_covariance(rng, 2, 0.1 if alike else float(10 ** rng.uniform(-2, 0))) for _ in range(n)]
    )
    d = means[0] - poses[0, :2]
    bearing = wrap_angle(np.arctan2(d[1], d[0]) - poses[0, 2])
    z = np.round([np.hypot(*d), bearing] + rng.normal(0, 0.1, 2), 3)
    w = rng.random(n) + 0.1
    return poses, w / w.sum(), means, covs, z, a_covariance(rng, 2, 0.02)


check_look = Check(
    _look,
    "weights, means, covs",
    {
        "one particle": _particles(1),
        "two particles that know the landmark equally well": _particles(2, alike=True),
        "particles that know it more and less well": _particles(5),
        "a landmark across the back": _particles(4, behind=True),
        "a surprise to all of them": lambda rng: (
            *(given := _particles(3)(rng))[:4],
            given[4] + np.array([30.0, 0.0]),
            given[5],
        ),
    },
    {
        "the weight was computed with R alone: the landmark is in doubt too, S = H P H^T + R": (
            'np.einsum("mi,mij,mj->m", v, W, v) - 0.5 * np.log(np.linalg.det(S))'
            ' => np.einsum("mi,ij,mj->m", v, np.linalg.inv(R), v)'
        ),
        "the determinant is missing: a particle that knows little is not surprised by anything": (
            " - 0.5 * np.log(np.linalg.det(S)) => "
        ),
        "the determinant stands without its root: -1/2 log det S": (
            "- 0.5 * np.log(np.linalg.det => - np.log(np.linalg.det"
        ),
        "the determinant has the wrong sign": (
            "- 0.5 * np.log(np.linalg.det => + 0.5 * np.log(np.linalg.det"
        ),
        "the half in the exponent is missing": (
            "log = -0.5 * np.einsum => log = -1.0 * np.einsum"
        ),
        "the densities underflow: subtract the largest logarithm before the exponential": (
            "np.exp(log - log.max()) => np.exp(log)"
        ),
        "the old weights are forgotten": "new = weights * np.exp => new = np.exp",
        "the weights do not sum to one: divide by their sum": "new / new.sum(), => new,",
        "divided by the largest weight: they must sum to one": (
            "new / new.sum() => new / new.max()"
        ),
        "the bearing is not wrapped": "wrap_angle(z[1] - bearing) => z[1] - bearing",
        "the heading of each particle must be taken off the bearing": (
            "np.arctan2(d[:, 1], d[:, 0]) - poses[:, 2] => np.arctan2(d[:, 1], d[:, 0])"
        ),
        "R is missing in S": "H.transpose(0, 2, 1) + R => H.transpose(0, 2, 1)",
        "the covariances did not shrink: P - K S K^T is due": (
            "covs - K @ S @ K.transpose(0, 2, 1) => covs.copy()"
        ),
        "the means did not move": 'means + np.einsum("mij,mj->mi", K, v) => means.copy()',
        "the innovation has the wrong sign: measured minus predicted": (
            'means + np.einsum("mij,mj->mi", K, v) => means - np.einsum("mij,mj->mi", K, v)'
        ),
        "all particles look from the pose of the first: each has its own": (
            lambda poses, *rest: _look(np.repeat(poses[:1], len(poses), 0), *rest)
        ),
        "all particles share the map of the first": lambda poses, w, means, covs, z, R: _look(
            poses, w, np.repeat(means[:1], len(w), 0), np.repeat(covs[:1], len(w), 0), z, R
        ),
    },
    tolerance=1e-6,
)
