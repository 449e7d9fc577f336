"""``python -m contimpact``: the same door as the command ``contimpact``."""

import sys

from .cli import main

sys.exit(main())
