"""Can one scan tell the place? Signatures that do not depend on where the robot looks.

P5, section 3.2.6: circular autocorrelation (the second formula numbered 14), the three-number
signature as printed and repaired, and a map of signatures. Chapter 19 tells the story.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from slamlab._checks import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_distances,
    as_instance,
    as_positive,
    as_scalar,
)
from slamlab._files import read_npz
from slamlab._optional import with_bar
from slamlab.geometry import compose, wrap_angle
from slamlab.models import World, as_scan_sensor
from slamlab.sensors.lidar import Lidar
from slamlab.worlds import BitmapWorld

__all__ = ["Location", "SignatureMap", "autocorrelation", "spectrum", "three_numbers"]

Bools = NDArray[np.bool_]

# Harmonics that a map compares: in P5's room 16 find the place as often as all 61 (chapter 19).
N_HARMONICS = 16
# Places more than this many pitches apart are distinct: at P5's stride of two pixels 14 pixels,
# half the side of its robot.
SEPARATION = 7
# A beam that misfits by more than this many pitches counts as this many: at the edge of an
# obstacle a range jumps.
CAP = 5
# Places that the tree proposes and whose whole scans are compared. At most 149 points of a grid
# lie within SEPARATION of one of them, so that many stand elsewhere.
N_CANDIDATES = 192
# The same place counts as a distinct pose if the heading differs by more than this (rad).
OTHER_HEADING = np.deg2rad(30)

FORMAT = "slamlab signature map 1"


# What a scan keeps when the robot turns.


def autocorrelation(scan: ArrayLike) -> Array:
    """Circular autocorrelation of a full-circle scan, P5's second (14) on a ring of beams.

    R[tau] = sum_j d[j] d[(j - tau) mod N]. A turn of the robot by a whole number of beams leaves
    it as it is, and so does reading the beams backwards.

    Parameters
    ----------
    scan : array_like, shape (..., n_beams)
        Ranges of at least one beam, evenly spread over the full circle, every one finite.

    Returns
    -------
    ndarray, shape (..., n_beams)
        In squared units of the scan; index 0 is the shift 0.

    Examples
    --------
    >>> autocorrelation([1, 2, 4, 0]).round(6).tolist()
    [21.0, 10.0, 8.0, 10.0]
    >>> autocorrelation([4, 0, 1, 2]).round(6).tolist()
    [21.0, 10.0, 8.0, 10.0]
    """
    scan = _as_scan(scan)
    # Wiener and Khinchin: the transform of R is the squared modulus of the scan's transform.
    power = np.abs(np.fft.rfft(scan)) ** 2
    return as_array("square of scan", np.fft.irfft(power, scan.shape[-1]))


def spectrum(scan: ArrayLike, n_harmonics: int | None = None) -> Array:
    """Root of the autocorrelation's Fourier transform: the same content, in units of the scan.

    With all harmonics it holds what the autocorrelation holds, and the distance of two spectra
    never exceeds the distance of the two scans at their best alignment (in the norm of n_beams
    numbers).

    Parameters
    ----------
    scan : array_like, shape (..., n_beams)
        Ranges of at least one beam, evenly spread over the full circle, every one finite.
    n_harmonics : int, optional
        How many to keep, at least 1, the mean (harmonic 0) included; all ``n_beams // 2 + 1``
        without it.

    Returns
    -------
    ndarray, shape (..., n_harmonics)
        Scaled so that the squares of all harmonics sum to the squares of the ranges.

    Examples
    --------
    >>> scan = np.array([1.0, 2.0, 4.0, 2.0])
    >>> np.allclose(spectrum(scan), spectrum(np.roll(scan, 1)))  # a turn changes nothing
    True
    """
    scan = _as_scan(scan)
    n_beams = scan.shape[-1]
    # Harmonic k of a real scan stands for k and -k, except the mean and, if any, the last.
    weight = np.full(n_beams // 2 + 1, 2.0)
    weight[0] = 1.0
    if n_beams % 2 == 0:
        weight[-1] = 1.0
    keep = None if n_harmonics is None else as_count("n_harmonics", n_harmonics, low=1)
    amplitude = np.abs(np.fft.rfft(scan))[..., :keep]
    return amplitude * np.sqrt(weight[:keep] / n_beams)


def three_numbers(scan: ArrayLike, form: str = "printed") -> Array:
    """P5's signature of three numbers: largest, smallest, difference of their indices.

    Parameters
    ----------
    scan : array_like, shape (..., n_beams)
        Ranges of at least one beam, evenly spread over the full circle, every one finite.
    form : {"printed", "modular", "autocorrelation"}
        "printed": of the raw scan, indices subtracted as they are. "modular": the difference
        modulo n_beams, so that it survives a turn. "autocorrelation": of the autocorrelation,
        whose largest value stands at index 0 and whose smallest stands at tau and at
        n_beams - tau; the smaller index is taken.

    Returns
    -------
    ndarray, shape (..., 3)

    Examples
    --------
    >>> scan = np.array([1.0, 2.0, 4.0, 2.0])
    >>> three_numbers(scan).tolist(), three_numbers(np.roll(scan, 2)).tolist()
    ([4.0, 1.0, 2.0], [4.0, 1.0, -2.0])
    """
    scan = _as_scan(scan)
    form = as_choice("form", form, ("printed", "modular", "autocorrelation"))
    n_beams = scan.shape[-1]
    if form == "autocorrelation":
        half = autocorrelation(scan)[..., : n_beams // 2 + 1]
        return np.stack([half[..., 0], half.min(-1), half.argmin(-1).astype(float)], -1)
    difference = scan.argmax(-1) - scan.argmin(-1)
    if form == "modular":
        difference = difference % n_beams
    return np.stack([scan.max(-1), scan.min(-1), difference.astype(float)], -1)


# Where in a known world was this seen?

SIGNATURES: dict[str, Callable[[Array], Array]] = {
    "spectrum": lambda scan: spectrum(scan, N_HARMONICS),
    "autocorrelation": lambda scan: autocorrelation(scan)[..., : scan.shape[-1] // 2 + 1],
    "three numbers": lambda scan: three_numbers(scan, "autocorrelation"),
    "modular": lambda scan: three_numbers(scan, "modular"),
    "printed": lambda scan: three_numbers(scan, "printed"),
}


@dataclass(frozen=True)
class Location:
    """Answer of `SignatureMap.locate`; every array has the leading axes of the scans.

    Attributes
    ----------
    pose : ndarray, shape (..., 3)
        Best pose of the body (m, m, rad).
    residual : ndarray, shape (...)
        Mean misfit of a beam there (m); a single beam counts at most 5 pitches.
    second_pose : ndarray, shape (..., 3)
        Best distinct pose: farther away than 7 pitches, or turned by more than 30 degrees.
    second_residual : ndarray, shape (...)
        Its mean misfit (m).
    ambiguous : ndarray of bool, shape (...)
        True if the second pose fits worse by less than the pitch of the map.
    """

    pose: Array
    residual: Array
    second_pose: Array
    second_residual: Array
    ambiguous: Bools

    @property
    def margin(self) -> Array:
        """How much worse (m) the second pose fits, shape (...)."""
        return np.asarray(self.second_residual - self.residual)


class SignatureMap:
    """Scans of many places of a known world, found again by signatures that ignore the heading.

    A tree over the signatures proposes candidates, the whole scans of the best of them are
    aligned with the one measured, and the best fit wins. The best fit elsewhere is reported too.

    A beam that met nothing (infinity, or `max_range` and more) counts as `reach`: that it is
    free so far is knowledge. A missed return (NaN) knows nothing: the signature bridges it by
    interpolation along the circle, and it has no vote when scans are compared.

    Parameters
    ----------
    places : array_like, shape (n, 2)
        Where the lidar stood (m), at least one.
    scans : array_like, shape (n, n_beams)
        Noise-free ranges (m) of three beams or more with heading 0, none missed; beam i at the
        angle 2 pi i / n_beams. Kept as float32.
    pitch : float
        Distance of neighbouring places (m), positive.
    reach : float
        Range (m) that stands for a beam that met nothing, positive.
    offset : float, default 0.0
        Distance of the lidar ahead of the body centre (m).
    signature : {"spectrum", "autocorrelation", "three numbers", "modular", "printed"}
        What the tree compares: 16 harmonics of `spectrum`, the autocorrelation, or one of the
        forms of `three_numbers`.

    Attributes
    ----------
    places, scans : ndarray
    pitch, reach, offset : float
    signature : str
    tree : scipy.spatial.cKDTree
        Over the signatures, row for row.

    Examples
    --------
    >>> from slamlab.sensors import Lidar
    >>> from slamlab.worlds import rooms
    >>> room, lidar = rooms.thesis_room(), Lidar(120)
    >>> atlas = SignatureMap.build(room, lidar, stride=8)
    >>> found = atlas.locate(lidar.scan(room, [1.0, 2.0, 0.7]))
    >>> found.pose.round(1).tolist(), bool(found.ambiguous)
    ([1.0, 2.0, 0.7], False)
    """

    def __init__(
        self,
        places: ArrayLike,
        scans: ArrayLike,
        pitch: float,
        reach: float,
        offset: float = 0.0,
        signature: str = "spectrum",
    ) -> None:
        self.places = as_array("places", places, ("n", 2)).astype(float)
        if len(self.places) == 0:
            raise ValueError("places: expected at least one, got none: no cell is free")
        ranges = as_distances("scans", scans, (len(self.places), "n_beams"))
        if ranges.shape[1] < 3:
            raise ValueError(f"scans: expected at least three beams, got {ranges.shape[1]}")
        self.pitch = as_positive("pitch", pitch, 1e300)
        self.reach = as_positive("reach", reach, 1e300)
        self.offset = as_scalar("offset", offset, low=-1e300, high=1e300)
        self.signature = as_choice("signature", signature, tuple(SIGNATURES))
        self.scans = np.minimum(ranges, self.reach).astype(np.float32)
        if np.isnan(self.scans).any():
            raise ValueError("scans: expected no missed return (NaN) in the scans of a map")
        self.tree = cKDTree(SIGNATURES[self.signature](_as_scan(self.scans, "scans")))

    @classmethod
    def build(
        cls,
        world: World,
        lidar: Lidar,
        stride: int = 2,
        resolution: float | None = None,
        progress: bool = False,
    ) -> SignatureMap:
        """Scan a known world from every `stride`-th cell that is free.

        Parameters
        ----------
        world : World
            A `BitmapWorld` is scanned from the centres of its cells.
        lidar : Lidar
            Full circle, beam 0 straight ahead. Its noise is left out; `max_range` and `offset`
            count.
        stride : int, default 2
            P5 takes every second pixel of every second row; at least 1.
        resolution : float, optional
            Side of a cell (m), for worlds without cells such as `WallWorld`, and only for them.
        progress : bool, default False
            Show a progress bar; ImportError without tqdm.

        Returns
        -------
        SignatureMap

        Raises
        ------
        ValueError
            If no cell is free.
        """
        stride = as_count("stride", stride, low=1)
        as_instance("world", world, World)
        angles = _full_circle(lidar)
        grid, pitch = _grid(world, stride, resolution)
        left, bottom, right, top = world.bounds
        reach = min(float(lidar.max_range), float(np.hypot(right - left, top - bottom)))
        free = np.asarray(world.is_free(grid))
        scans = np.empty((int(free.sum()), len(angles)), np.float32)
        parts = np.array_split(np.arange(len(angles)), len(angles) // 8 + 1)
        for part in with_bar(parts, progress, len(parts), "part"):
            scans[:, part] = _ranges(world, grid[free], angles[part])
        return cls(grid[free], scans, pitch, reach, lidar.offset)

    def with_signature(self, signature: str) -> SignatureMap:
        """Return a map of the same scans that is searched by another signature."""
        return SignatureMap(
            self.places, self.scans, self.pitch, self.reach, self.offset, signature
        )

    @property
    def n_beams(self) -> int:
        """Number of beams of a scan."""
        return int(self.scans.shape[1])

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.places)

    def __repr__(self) -> str:
        """Return one stable line."""
        return (
            f"SignatureMap({len(self)} places, {self.n_beams} beams, "
            f"pitch {self.pitch:g} m, {self.signature})"
        )

    def locate(self, scan: ArrayLike, n_candidates: int = N_CANDIDATES) -> Location:
        """Find pose and heading from one scan, and the best distinct pose that it may be instead.

        Parameters
        ----------
        scan : array_like, shape (..., n_beams)
            Measured ranges (m): infinity met nothing, NaN was missed.
        n_candidates : int, default 192
            Among how many of the nearest signatures the best fit of the whole scan decides;
            1 trusts the signature alone. At least 192 are searched for the second pose.

        Returns
        -------
        Location

        Raises
        ------
        ValueError
            If a scan has fewer than three returns.
        """
        scan = as_distances("scan", scan, ("...", self.n_beams))
        n_candidates = as_count("n_candidates", n_candidates, low=1)
        ranges = np.minimum(scan, self.reach).reshape(-1, self.n_beams)
        returns = (~np.isnan(ranges)).sum(1)
        if (returns < 3).any():
            k = int(np.argmax(returns < 3))
            raise ValueError(f"scan: expected at least three returns, scan {k} has {returns[k]}")
        # A few scans at a time: their candidates then stay in the cache.
        eights = range(0, max(len(ranges), 1), 8)
        parts = [self._locate(ranges[i : i + 8], n_candidates) for i in eights]
        lead = scan.shape[:-1]
        poses = np.concatenate([part[0] for part in parts]).reshape(*lead, 2, 3)
        residuals = np.concatenate([part[1] for part in parts]).reshape(*lead, 2)
        margin = residuals[..., 1] - residuals[..., 0]
        return Location(
            pose=poses[..., 0, :],
            residual=residuals[..., 0],
            second_pose=poses[..., 1, :],
            second_residual=residuals[..., 1],
            ambiguous=np.asarray(margin < self.pitch),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the map to an npz file, which holds arrays only and no pickle."""
        with open(path, "wb") as file:
            np.savez(
                file,
                format=np.array(FORMAT),
                places=self.places,
                scans=self.scans,
                numbers=np.array([self.pitch, self.reach, self.offset]),
                signature=np.array(self.signature),
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SignatureMap:
        """Read a map that `save` wrote.

        Raises
        ------
        ValueError
            If the file is no such map, is truncated or damaged; the message names file and part.
        FileNotFoundError
            If there is no file.
        """
        parts = read_npz(path, what="signature map, npz")
        for name in ("format", "places", "scans", "numbers", "signature"):
            if name not in parts:
                raise ValueError(f"{path}: expected a signature map, npz ({name!r} is missing)")
        if str(parts["format"]) != FORMAT:
            raise ValueError(f"{path}: format: expected {FORMAT!r}, got {str(parts['format'])!r}")
        try:
            pitch, reach, offset = as_array("numbers", parts["numbers"], (3,))
            name = str(parts["signature"])
            return cls(parts["places"], parts["scans"], pitch, reach, offset, name)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error

    # Inside, data is trusted.

    def _locate(self, ranges: Array, n_candidates: int) -> tuple[Array, Array]:
        """Best and second poses (M, 2, 3) of the body, with residuals (M, 2), of M scans."""
        known = ~np.isnan(ranges)
        signatures = SIGNATURES[self.signature](_bridged(ranges, known))
        k = np.arange(1, min(max(N_CANDIDATES, n_candidates), len(self)) + 1)
        candidates = self.tree.query(signatures, k=k)[1]
        # Cross-correlation aligns the scan with each candidate; capped misfits judge the fit.
        misfits = self._misfits(ranges, known, candidates)
        shifts = _least(misfits)
        residuals = self._residuals(ranges, known, candidates, shifts[..., None])[..., 0]
        rows = np.arange(len(ranges))
        best = residuals[:, :n_candidates].argmin(1)
        # The best place once more, with every heading but the best, is one candidate more.
        again = candidates[rows, best, None]
        turned = _least(misfits[rows, best, None], shifts[rows, best])
        candidates, shifts = np.hstack([candidates, again]), np.hstack([shifts, turned])
        residual = self._residuals(ranges, known, again, turned[..., None])[..., 0]
        distinct = self._distinct(candidates, shifts, best)
        misfit = np.where(distinct, np.hstack([residuals, residual]), np.inf)
        two = rows[:, None], np.column_stack([best, misfit.argmin(1)])
        poses, residual = self._polished(ranges, known, candidates[two], shifts[two])
        if n_candidates > 1:  # otherwise the nearest signature comes first, however it fits
            order = rows[:, None], residual.argsort(1, kind="stable")
            poses, residual = poses[order], residual[order]
        return compose(poses, [-self.offset, 0.0, 0.0]), residual

    def _misfits(self, ranges: Array, known: Bools, candidates: NDArray[np.intp]) -> Array:
        """Squared misfits (M, k, n_beams) of scans at candidates, for every turn by whole beams.

        Sum over the known beams of (scan[i] - stored[i + shift])^2, multiplied out.
        """
        stored = self.scans[candidates].astype(float)
        scan = np.where(known, ranges, 0.0)[:, None]
        product = np.conj(np.fft.rfft(scan)) * np.fft.rfft(stored)
        squares = (scan**2).sum(-1)[..., None] - 2 * np.fft.irfft(product, self.n_beams)
        if known.all():
            return squares + (stored**2).sum(-1)[..., None]
        votes = np.conj(np.fft.rfft(known.astype(float)))[:, None]
        return squares + np.fft.irfft(votes * np.fft.rfft(stored**2), self.n_beams)

    def _distinct(self, candidates: NDArray[np.intp], shifts: Array, best: Array) -> Bools:
        """Whether candidates (M, k) stand elsewhere than the best one, or look elsewhere."""
        rows = np.arange(len(best)), best
        places = self.places[candidates]
        gap = np.hypot(*np.moveaxis(places - places[rows][:, None], -1, 0))
        turn = (shifts - shifts[rows][:, None]) * (2 * np.pi / self.n_beams)
        distinct = (gap > SEPARATION * self.pitch) | (np.abs(wrap_angle(turn)) > OTHER_HEADING)
        distinct[:, -1] = True
        return np.asarray(distinct)

    def _polished(
        self, ranges: Array, known: Bools, candidates: NDArray[np.intp], shifts: Array
    ) -> tuple[Array, Array]:
        """Poses (M, k, 3) of the lidar with the least capped misfit within half a beam.

        The parabola serves squares, which one jump at a corner can rule; the cap bounds its say.
        """
        trials = shifts[..., None] + np.linspace(-0.5, 0.5, 21)
        residuals = self._residuals(ranges, known, candidates, trials)
        shift = np.take_along_axis(trials, residuals.argmin(-1)[..., None], -1)
        heading = wrap_angle(shift * (2 * np.pi / self.n_beams))
        poses = np.concatenate([self.places[candidates], heading], -1)
        return poses, residuals.min(-1)

    def _residuals(
        self, ranges: Array, known: Bools, candidates: NDArray[np.intp], shifts: Array
    ) -> Array:
        """Mean capped misfit (M, k, s) of scans at candidates (M, k) turned by shifts.

        Between whole beams the stored ring is interpolated.
        """
        whole = np.floor(shifts).astype(np.intp)[..., None]
        part = shifts[..., None] - whole
        beam = (np.arange(self.n_beams) + whole) % self.n_beams
        turned = np.take(self.scans, candidates[..., None, None] * self.n_beams + beam)
        predicted = (1 - part) * turned + part * np.roll(turned, -1, -1)
        misfit = np.minimum(np.abs(predicted - ranges[:, None, None]), CAP * self.pitch)
        votes = known.sum(1)[:, None, None]
        return np.asarray(np.where(known[:, None, None], misfit, 0.0).sum(-1) / votes)


def _least(misfits: Array, excluded: Array | None = None) -> Array:
    """Shifts (M, k) in beams at which misfits (M, k, n_beams) are least, to a part of a beam.

    The vertex of the parabola through the least misfit and its neighbours. Shifts within
    `OTHER_HEADING` of `excluded` (M,) do not count, if given.
    """
    n_beams = misfits.shape[-1]
    allowed = misfits
    if excluded is not None:
        gap = np.abs(np.arange(n_beams) - excluded[:, None]) % n_beams
        near = np.minimum(gap, n_beams - gap) <= OTHER_HEADING * n_beams / (2 * np.pi)
        allowed = np.where(near[:, None], np.inf, misfits)
    best = allowed.argmin(-1)
    before, least, after = (
        np.take_along_axis(misfits, (best[..., None] + d) % n_beams, -1)[..., 0]
        for d in (-1, 0, 1)
    )
    curvature = before - 2 * least + after
    fraction = np.zeros_like(curvature)
    np.divide(before - after, 2 * curvature, out=fraction, where=curvature > 0)
    return np.asarray(best + np.clip(fraction, -0.5, 0.5))


def _as_scan(scan: ArrayLike, name: str = "scan") -> Array:
    scan = as_array(name, scan, ("...", "n_beams")).astype(float, copy=False)
    if scan.shape[-1] == 0:
        raise ValueError(f"{name}: expected at least one beam, got none")
    return scan


def _bridged(ranges: Array, known: Bools) -> Array:
    """Missed returns filled in between their neighbours on the circle."""
    beams, rows = np.arange(ranges.shape[1]), zip(ranges, known, strict=True)
    whole = [np.interp(beams, beams[k], row[k], period=len(beams)) for row, k in rows]
    return np.reshape(whole, ranges.shape)


def _full_circle(lidar: Lidar) -> Array:
    """Beam angles, if they are those of a full circle."""
    angles = as_scan_sensor("lidar", lidar).beam_angles
    due = np.arange(len(angles)) * (2 * np.pi / len(angles))
    if len(angles) < 3 or np.abs(wrap_angle(angles - due)).max() > 1e-9:
        raise ValueError(
            "lidar: expected three or more beams over the full circle, got "
            f"{len(angles)} over {np.ptp(angles) if len(angles) else 0:g} rad"
        )
    return angles


def _grid(world: World, stride: int, resolution: float | None) -> tuple[Array, float]:
    """Points (rows, columns, 2) from which a world is scanned, and their distance."""
    if isinstance(world, BitmapWorld):
        if resolution is not None:
            raise ValueError(
                f"resolution: expected None, a bitmap has its own, got {resolution:g}"
            )
        return world.centres(stride), stride * world.resolution
    if resolution is None:
        raise ValueError("resolution: expected the side of a cell (m) for a world without cells")
    cell = as_scalar("resolution", resolution, 1e-9, 1e9)
    left, bottom, right, top = world.bounds
    x = np.arange(left + cell / 2, right, stride * cell)
    y = np.arange(bottom + cell / 2, top, stride * cell)
    return np.stack(np.meshgrid(x, y), -1), stride * cell


def _ranges(world: World, places: Array, angles: Array) -> Array:
    """Ranges (n, n_angles) from places (n, 2); inf where a beam met nothing."""
    # A direction after the other: all beams of all places at once would fill the memory.
    return np.array([world.cast(places, angle) for angle in angles]).T
