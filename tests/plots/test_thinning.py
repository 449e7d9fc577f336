"""Outlines with as few points as are seen."""

from __future__ import annotations

import numpy as np

from contimpact.plots.curves import SEEN, thin_ring


def circle(number, radius=0.4):
    turn = np.linspace(0.0, 2.0 * np.pi, number)
    return 0.5 + radius * np.column_stack([np.cos(turn), np.sin(turn)])


def off(points, kept):
    """How far left out points are from the outline that is kept."""
    outline = (
        np.interp(np.arange(len(points)), kept, points[kept, 0]),
        np.interp(np.arange(len(points)), kept, points[kept, 1]),
    )
    return np.min(
        np.hypot(*(points[:, None] - np.column_stack(outline)[None]).transpose(2, 0, 1)), axis=1
    ).max()


def test_a_circle_has_as_many_points_as_are_seen():
    points = circle(2000)
    kept = thin_ring(points, [0])
    assert (kept[0], kept[-1]) == (0, 1999)
    assert 30 < len(kept) < 150
    assert off(points, kept) < SEEN
    assert len(thin_ring(circle(20000), [0])) < 150


def test_corners_are_kept_and_neighbours_keep_the_same():
    line = np.column_stack([np.linspace(0.0, 1.0, 101), np.zeros(101)])
    ring = np.vstack([line, [[0.5, 1.0]], line[:1]])
    assert thin_ring(ring, [0, 40]).tolist() == [0, 40, 100, 101, 102]
    wave = np.column_stack([line[:, 0], 0.1 * np.sin(7.0 * line[:, 0])])
    above = np.vstack([wave, [[0.5, 1.0]], wave[:1]])
    below = np.vstack([wave[::-1], [[0.5, -1.0]], wave[-1:]])
    kept = [{*map(tuple, ring[thin_ring(ring, [0, 100])])} for ring in (above, below)]
    assert kept[0] - kept[1] == {(0.5, 1.0)}
