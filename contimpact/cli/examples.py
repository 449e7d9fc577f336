"""An example for every command, as its help and the manual show it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

EXAMPLES = {
    "new": "contimpact new impact-pair",
    "systems": "contimpact systems",
    "check": "contimpact check branches/fig7/scene.toml",
    "run": "contimpact run branches/fig7/scene.toml -o out/fig7",
    "simulate": "contimpact simulate branches/fig7/scene.toml -o out/fig7/simulation --resume",
    "report": "contimpact report branches/fig7/scene.toml -o out/fig7/report -n 3",
    "catalogue": "contimpact catalogue out/fig7 out/fig8 -o out/both",
    "plot": "contimpact plot out/fig7 -x d -y multipliers --xlim 0.13 0.25 -o multipliers.svg",
    "view": "contimpact view out/fig7",
    "range": "contimpact range out/fig7 --at 0.3 --at 0.356",
    "fit": "contimpact fit branches/fig8/scene.toml impacts.csv --parameter r -o residuals.png",
    "design": "contimpact design examples/harvester.toml -o design.csv",
    "certify": "contimpact certify out/fig7",
    "study": "contimpact study branches/atlas/A5.toml -o competition.sqlite --workers 2",
    "export": "contimpact export competition.sqlite -o out/tables --format csv.gz --table events",
    "atlas": "contimpact atlas competition.sqlite -o out/maps --quantity mechanism --axes beta r",
    "completion": 'eval "$(contimpact completion bash)"',
}


def commands_of(parser: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """Return the parsers of the commands, by name."""
    kind = argparse._SubParsersAction
    (found,) = (action for action in parser._actions if isinstance(action, kind))
    return found.choices


def add_examples(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Return a parser whose commands end their help with an example each."""
    for name, command in commands_of(parser).items():
        if name in EXAMPLES:
            command.epilog = f"example:\n  {EXAMPLES[name]}"
            command.formatter_class = argparse.RawDescriptionHelpFormatter
    return parser
