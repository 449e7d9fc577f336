"""What of a system was compared: kept in the cache, so that a warm check does without SymPy."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

from ..models.model import Model
from ..models.sources import digests, identity_of
from ..storage.cache import cache_folder, keep, kept, logger
from ..storage.files import reason

HERE = Path(__file__).parent


def checked(model: Model) -> list[str]:
    """Return what `check_model` has compared, once for a model's formulas, values and version.

    Raises
    ------
    InputError
        Naming what contradicts itself.
    """
    folder, key = cache_folder(), _key(model)
    system = re.sub(r"\W", "_", model.SYSTEM)
    path = folder / f"{system}-checked-{key[:16]}.json" if folder else None
    try:
        record = json.loads(kept(path)) if path else None
    except (OSError, ValueError):
        record = None
    if isinstance(record, dict) and record.get("key") == key:
        return list(record["compared"])
    from .checking import check_model

    compared = check_model(model)
    try:
        if path:
            keep(path, json.dumps({"key": key, "compared": compared}).encode())
    except OSError as error:
        logger(__name__).warning("%s is not cached: %s", path, reason(error))
    return compared


def _key(model: Model) -> str:
    """What was compared, and by what files."""
    files = (HERE / "checking.py", HERE.parent / "models" / "agreement.py")
    comparing = (hashlib.sha256(file.read_bytes()).hexdigest() for file in files)
    parts = (identity_of(model), repr(model.values), *comparing, *digests())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()
