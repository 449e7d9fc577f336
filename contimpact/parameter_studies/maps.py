"""Maps of a study: a quantity over two of its axes, with curves of codimension two over it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models import expressions
from .quantities import along, quantity

if TYPE_CHECKING:
    from .study import Study

NEAR = 1e-9
"""Values of an axis that differ by less, of their size, are the same."""
SPARSE = 5
"""Points of which there is one to more places than that of a grid are no grid."""


@dataclass(frozen=True, eq=False)
class Map:
    """A quantity over two axes.

    Attributes
    ----------
    study, quantity, text : str
        Of what, which, and what is said of it.
    axes : (str, str)
    x, y : ndarray of shape (points,)
    values : ndarray of shape (points,)
        Numbers, NaN where there is none; or names, None where there is none.
    named : bool
        Whether the values are names.
    curves : mapping of str to ndarray of shape (n, 2)
        Points of codimension two that studies of the same store have found, by kind.
    """

    study: str
    quantity: str
    text: str
    axes: tuple[str, str]
    x: Array
    y: Array
    values: Array
    named: bool
    curves: Mapping[str, Array] = field(default_factory=dict)

    def grid(self) -> tuple[Array, Array, Array] | None:
        """Return the values on x and y as a table with a row for each y; None if the points are no
        grid, of which a part may be missing."""
        xs, ys = np.unique(self.x), np.unique(self.y)
        if len(xs) * len(ys) > SPARSE * len(self.x):
            return None
        table = np.full((len(ys), len(xs)), None if self.named else np.nan, self.values.dtype)
        table[np.searchsorted(ys, self.y), np.searchsorted(xs, self.x)] = self.values
        return xs, ys, table

    def zeros(self) -> Array:
        """Return where the values change sign along y, interpolated linearly, shape (n, 2).

        Raises
        ------
        InputError
            If the points are no grid, or the values names.
        """
        grid = None if self.named else self.grid()
        if grid is None:
            found = "names" if self.named else "points that are no grid"
            raise InputError(f"map {self.quantity}", found, "give numbers over a grid")
        xs, ys, table = grid
        found_at = []
        for x, column in zip(xs, table.T, strict=True):
            for k in np.flatnonzero(column[:-1] * column[1:] < 0.0):
                part = column[k] / (column[k] - column[k + 1])
                found_at.append([x, ys[k] + part * (ys[k + 1] - ys[k])])
        return np.array(found_at).reshape(-1, 2)

    def departure(self, kind: str) -> float | None:
        """Return how far, in y, `zeros` are at most from the points of codimension two of a kind.

        These are joined by straight lines; None where they pass no zero.
        """
        zeros, points = self.zeros(), self.curves.get(kind, np.zeros((0, 2)))
        if not len(points):
            return None
        inside = (zeros[:, 0] >= points[0, 0]) & (zeros[:, 0] <= points[-1, 0])
        x, y = zeros[inside].T
        return float(np.max(np.abs(y - np.interp(x, *points.T)))) if len(x) else None


def map_of(
    study: Study,
    name: str,
    axes: Sequence[str] | None = None,
    orbit: str = "1:1",
    at: Mapping[str, float] | None = None,
) -> Map:
    """Return a quantity of a study over two axes.

    Parameters
    ----------
    study : Study
    name : str
        A quantity: ``ends``, ``mechanism``, ``distance``, ``bistability``, ``energy``, ``margin``
        or ``count:LABEL``; see `contimpact.parameter_studies.quantities`.
    axes : (str, str), optional
        The first two of the study by default.
    orbit : str
        The notation of the orbit it is asked of.
    at : mapping of str to float, optional
        Values of the study's other axes, if it has any.

    Raises
    ------
    InputError
        If there is no such quantity or axis, or another axis is left open.
    """
    which, chosen = quantity(name), _axes(study, axes)
    places = _scenes_at(study, chosen, at or {})
    known = which.values(study, orbit)
    empty = None if which.named else np.nan
    values = [known.get(scene, empty) for scene in places]
    values = [empty if v is None else v for v in values]
    x, y = np.array(list(places.values())).reshape(-1, 2).T
    said = which.text.format(orbit=orbit, along=along(study), parameter=study.parameter)
    kind: Any = object if which.named else float
    column = np.array(values, dtype=kind)
    curves = codimension_two(study, chosen, orbit, at or {})
    return Map(study.name, name, said, chosen, x, y, column, which.named, curves)


def _axes(study: Study, axes: Sequence[str] | None) -> tuple[str, str]:
    x, y = (*(axes or study.axes[:2]), "", "")[:2]
    for name in (x, y):
        if name not in study.axes or x == y:
            accepted = f"give two of {', '.join(study.axes)}"
            raise InputError("axes", f"found {x!r} and {y!r}", accepted)
    return x, y


def _scenes_at(
    study: Study, axes: tuple[str, str], at: Mapping[str, float]
) -> dict[int, tuple[float, float]]:
    """The finished scenes at values of the other axes, with their places."""
    for name in (*at, *study.axes):
        if name not in study.axes or (name in at) == (name in axes):
            open_ = ", ".join(a for a in study.axes if a not in axes) or "none"
            raise InputError("at", f"found {', '.join(at) or 'nothing'}", f"give values of {open_}")
    columns = study.scenes().arrays()
    keep = np.ones(len(columns["scene"]), dtype=bool)
    for name, value in at.items():
        nearest = columns[name][np.abs(columns[name] - value).argmin()]
        keep &= np.abs(columns[name] - nearest) <= NEAR * max(abs(nearest), NEAR)
    places = zip(*(columns[name][keep].tolist() for name in axes), strict=True)
    return dict(zip(columns["scene"][keep].tolist(), places, strict=True))


def codimension_two(
    study: Study, axes: tuple[str, str], orbit: str, at: Mapping[str, float]
) -> dict[str, Array]:
    """Return the points of codimension two over two axes that any study of the store has found, by
    kind.

    A point counts if it is of the same system, and of the same values of all parameters but the
    axes and the followed one.
    """
    found: dict[str, list[list[float]]] = {}
    free, own = {*axes, study.parameter}, _fixed(study.given) | dict(at)
    for number, other in _other_studies(study):
        query = (
            "SELECT scene, kind, first, first_value, second, second_value"
            " FROM codimension_two WHERE study = ? AND notation = ?"
        )
        for scene, kind, first, one, second, two in study.rows(query, [number, orbit]):
            placed = other | _coordinates(study, number, scene) | {first: one, second: two}
            agree = all(own.get(n) == placed.get(n) for n in {*own, *placed} - free)
            if agree and {*axes} <= {*placed}:
                found.setdefault(kind, []).append([placed[name] for name in axes])
    return {kind: np.array(sorted(points)) for kind, points in found.items()}


def _other_studies(study: Study) -> Iterator[tuple[int, dict[str, float]]]:
    """The studies of the same system that may have such points, with their fixed parameters."""
    system = _system(study.given)
    for number, record in study.rows("SELECT study, record FROM studies"):
        given = json.loads(record)
        if _system(given) == system:
            yield number, _fixed(given)


def _system(given: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in given["model"].items() if key != "parameters"}


def _fixed(given: Mapping[str, Any]) -> dict[str, float]:
    """The parameters that a study gives all its scenes."""
    parameters = given["model"].get("parameters", {})
    return {
        n: expressions.number(v, n) if isinstance(v, str) else float(v)
        for n, v in parameters.items()
    }


def _coordinates(study: Study, number: int, scene: int) -> dict[str, float]:
    query = "SELECT name, value FROM coordinates WHERE study = ? AND scene = ?"
    return dict(study.rows(query, [number, scene]))
