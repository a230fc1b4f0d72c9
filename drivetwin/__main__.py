"""``python -m drivetwin``."""

from drivetwin.cli import main

main()
