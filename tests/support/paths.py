"""Where the checkout and the reference data lie."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHARED = Path(os.environ.get("KARMA_SHARED", ROOT.parent / "shared"))
GOLDEN = ROOT / "tests" / "golden"
