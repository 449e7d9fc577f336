"""Calls one function in a process of its own: python child.py MODULE FUNCTION ARGUMENTS.

The arguments are a JSON list; what the function returns is printed as JSON.
"""

from __future__ import annotations

import importlib
import json
import sys


def main() -> None:
    module, function, arguments = sys.argv[1:]
    result = getattr(importlib.import_module(module), function)(*json.loads(arguments))
    json.dump(result, sys.stdout)


if __name__ == "__main__":
    main()
