"""python -m strokeplan."""

from strokeplan.cli import main

main()
