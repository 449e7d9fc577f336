"""``contimpact export``: write the tables of a store as files."""

from __future__ import annotations

import argparse

from ..studies.export import export
from ..telling import telling
from .console import require_output
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Write the tables of a store; returns the exit status."""
    require_output(options)
    with telling("export", options.quiet, patient=True) as tell:
        tell("writing tables")
        written = export(
            options.store,
            options.output,
            options.format,
            names=options.study,
            tables=options.table,
            columns=options.columns,
            digits=options.digits,
        )
    if not options.quiet:
        for name, count in written.items():
            say(f"{name}: {count} rows")
    return 0
