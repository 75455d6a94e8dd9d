"""Shared pages: equal to plain copies whatever is written and copied, and much smaller."""

import numpy as np
import pytest

from slamlab.filters.pages import SharedPages

M, SLOTS, SHAPE = 6, 12, (4, 5)


def hammer(shared, rounds=80, seed=3, share=None):
    """Write and resample at random; return what plain copies of everything would hold."""
    rng = np.random.default_rng(seed)
    shared.extend(SLOTS)
    copies = np.full((M, SLOTS, *SHAPE), -1, np.int16)
    for _ in range(rounds):
        particles, slots = rng.integers(0, M, 9), rng.integers(0, SLOTS, 9)
        values = rng.integers(0, 999, 9)
        for i, slot, value in zip(particles, slots, values, strict=True):
            copies[i, slot, 2, 3] = value
        shared.pages[shared.own(particles, slots), 2, 3] = values
        if rng.random() < 0.4:
            chosen = rng.integers(0, M, M)
            shared.resample(chosen)
            copies = copies[chosen]
    return copies


def empty_pages(n=M):
    return SharedPages(n, np.full(SHAPE, -1, np.int16))


def test_they_equal_plain_copies_after_any_writes_and_resamplings():
    shared = empty_pages()
    copies = hammer(shared)
    np.testing.assert_array_equal(shared.pages[shared.table], copies)
    assert shared.pages.dtype == np.int16
    assert (shared.pages[0] == -1).all()


def test_one_array_that_all_copies_write_into_is_noticed(monkeypatch):
    # A peer's mistake: the copies of a particle keep pointing at one map and write into it.
    monkeypatch.setattr(
        SharedPages, "_allocate", lambda self, count: np.zeros(count, dtype=np.intp)
    )
    shared = empty_pages()
    assert not np.array_equal(shared.pages[shared.table], hammer(shared))


def test_memory_is_bounded_by_what_differs():
    shared = empty_pages(50)
    shared.extend(200)
    page = np.prod(SHAPE) * 2
    for first in range(0, 200, 20):
        # Each particle writes to 20 new slots, then one of them becomes everybody.
        particles, slots = np.divmod(np.arange(50 * 20), 20)
        shared.pages[shared.own(particles, first + slots)] = first
        assert shared.in_use <= first + 50 * 20
        shared.resample(np.full(50, 7))
        assert shared.in_use == first + 20
    assert shared.nbytes == 200 * page + shared.table.nbytes
    # The store itself has grown to the widest moment, not to the sum of all.
    assert len(shared.pages) < 1.3 * (180 + 50 * 20) + 2
    # One owner of many writes: one page is copied.
    shared.pages[shared.own([3], [5])] = 0
    assert shared.in_use == 201
    # Everybody writes: the last owner keeps the original.
    shared.own(np.arange(50), np.full(50, 8))
    assert shared.in_use == 201 + 49


def test_maps_may_grow_on_any_side():
    shared = empty_pages()
    copies = hammer(shared)
    where = np.random.default_rng(1).permutation(20)[:SLOTS]
    shared.rearrange(where, 20)
    grown = np.full((M, 20, *SHAPE), -1, np.int16)
    grown[:, where] = copies
    np.testing.assert_array_equal(shared.pages[shared.table], grown)
    shared.extend(5)
    assert shared.table.shape == (M, 20)


def test_owning_nothing_changes_nothing():
    shared = empty_pages()
    assert shared.own([], []).shape == (0,)
    assert (shared.in_use, shared.nbytes) == (0, 0)
    with pytest.raises(ValueError, match="n_particles"):
        SharedPages(0, [0.0])
