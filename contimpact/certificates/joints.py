"""Where tubes end: neighbours have to hold the same orbit at their common node.

Both test the hyperplane through the node to which the branch's direction there is normal, and each
holds one orbit in it. That of a tube is in the other one's box if a bound of its distance from the
node says so. That bound comes from the whole tube, and is too wide where branches cross nearby:
then an orbit is proven to lie near the node by Krawczyk's test there alone, in both boxes.
"""

from __future__ import annotations

from typing import Any

from flint import arb, ctx

from .birth import Birth
from .equations import Balls
from .krawczyk import column, krawczyk, preconditioner
from .tube import Node, Segment, Tube


def meet(one: Tube | Birth, other: Tube) -> bool:
    """Return whether a tube is proven to hold the same orbit as the next one, where they meet."""
    if isinstance(one, Birth):
        return one.meets(other)
    if (one.ends[1] < other.box).all() or (other.ends[0] < one.box).all():
        return True
    near = _orbit_near(one.segment, one.segment.last)
    places = one.segment.last.unknowns.tolist()
    boxes = zip(one.box.tolist(), other.box.tolist(), strict=True)
    return near is not None and all(
        bool(abs(x - p) < min(pair)) for x, p, pair in zip(near, places, boxes, strict=True)
    )


def _orbit_near(segment: Segment, node: Node) -> Balls | None:
    """A ball with one orbit in the hyperplane through a node; None if that is not proven."""
    space, scale = segment.space, segment.scale
    places = [arb(x) for x in node.unknowns.tolist()]
    row = (scale**-2 * node.tangent).tolist()  # to the last bit that of the tubes

    def system(z: list[Any]) -> list[Any]:
        away = (w * (x - p) for w, x, p in zip(row, z, places, strict=True))
        return [*space.residual(z), sum(away, arb(0))]

    inverse = preconditioner(space, system, places)
    if inverse is None:
        return None
    step = (inverse * column(system(places))).entries()
    least = arb(2) ** (20 - ctx.prec)
    halves = [
        2 * abs(s).upper() + least * unit for s, unit in zip(step, scale.tolist(), strict=True)
    ]
    box = [p + arb(0, 1) * half for p, half in zip(places, halves, strict=True)]
    return krawczyk(space, system, box, inverse)
