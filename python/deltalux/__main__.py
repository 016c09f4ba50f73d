"""python -m deltalux"""

import sys

from .command.cli import main

sys.exit(main())
