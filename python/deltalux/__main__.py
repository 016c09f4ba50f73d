"""python -m deltalux"""

from .command.cli import run

run()
