"""``python -m esea_gen.cli``."""

from esea_gen.cli import main

main()
