"""python -m strokeplan."""

from strokeplan.cli import run

run()
