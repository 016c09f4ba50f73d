"""The rows of the reliability card, one a file: each says `WHAT` it tries, its `SHARE` of the time, and how to `run`.

`run(clock, seed, folder)` tries things until the clock has run out, other things for every seed, writes where it is
told to, and returns a `Tally`. It runs in a process of its own: one that crashes or hangs has not survived.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
for _tests in ("python", "fuzz"):
    sys.path.append(str(ROOT / "tests" / _tests))
