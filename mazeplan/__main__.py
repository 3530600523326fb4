"""The `mazeplan` command, and `python -m mazeplan`: Ctrl-C is one line while the program is still being loaded, too."""

import sys


def main() -> None:
    """Entry point of the `mazeplan` command."""
    try:
        from mazeplan.apps.cli import main as command
    except KeyboardInterrupt:
        print("mazeplan: interrupted", file=sys.stderr)
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
