"""The public search for orbits of a word: from random starts, and by simulation."""

from __future__ import annotations

import numpy as np

from ..models.guards import graph
from ..models.model import Model
from ..models.word import Word, parse_word
from ..orbits import search
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..progress import Asked, asked
from ..segments.kernels import Kernels
from .starting_orbits import attracts


def find_orbits(
    model: Model,
    word: str | Word,
    parameter: str | None = None,
    *,
    kernels: Kernels | None = None,
    rng: np.random.Generator | int = 0,
    starts: int = 256,
    rounds: int = 8,
    progress: Asked = False,
) -> list[Orbit]:
    """Find the orbits of a word: stable, unstable and unphysical ones.

    Parameters
    ----------
    model : Model
        The system at the parameter values of interest.
    word : str or Word
        ``"2:1"``, ``"1:1/2T"``, ``"BTBT/2T"``, ...
    parameter : str, optional
        The parameter that will be followed; the first of the model by default, or the last where
        the period is free: the first ones may bring a forcing.
    kernels : Kernels, optional
        Kernels to use, if some are at hand; they name the parameter.
    rng : None, int or numpy.random.Generator, default 0
        Where starts come from; see `numpy.random.default_rng`.
    starts : int
        Starts in one round; fewer for words of more than a dozen impacts.
    rounds : int
        Rounds at most; the search ends after two rounds in a row that find nothing new.
    progress : bool or callable
        Whether to tell on standard error how far the search is, or a function to call with lines
        of text.

    Returns
    -------
    list of Orbit
        Sorted by the first impact's velocity, largest first; impacts in order of time, the first
        in [0, T). Where several rotations of the word read the same, the first impact is the
        fastest of those it can be. Repetitions of an orbit of shorter period are left out. The list
        can be incomplete: the search is a random one.

    Raises
    ------
    InputError
        If the word cannot be read or the parameter is unknown.

    Notes
    -----
    Where random starts lead to no orbit that is stable and physical, a few short simulations from
    random states are made as well: an attractor on which one of them settles is found.
    """
    first = list(model.values)[-1 if model.autonomous else 0]
    kernels = kernels or Kernels(model, parameter or first)
    found = search.find_orbits(
        model, word, kernels=kernels, rng=rng, starts=starts, rounds=rounds, progress=progress
    )
    if not isinstance(word, Word):
        word = parse_word(word, model.letters, graph=graph(model.WALLS), free=model.autonomous)
    if not word.walls or attracts(found):
        return found
    from .settled import of_word, settled_orbits

    with asked(progress, f"find_orbits {word}") as tell:
        tell("simulating from random states")
        settled = of_word(settled_orbits(model, kernels, rng), word)
    return search.with_more(found, problem_of(model, word, kernels), settled)
