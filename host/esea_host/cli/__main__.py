"""``python -m esea_host.cli``."""

from esea_host.cli import main

main()
