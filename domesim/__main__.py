"""``python -m domesim``."""

from domesim.cli import main

main()
