"""``python -m sidestep``."""

from sidestep.cli.app import main

main()
