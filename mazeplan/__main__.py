"""`python -m mazeplan` is the `mazeplan` command."""

from mazeplan.cli import main

main()
