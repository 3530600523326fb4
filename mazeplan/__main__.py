"""The `mazeplan` command, and `python -m mazeplan`: Ctrl-C is one line while the program is still being loaded, too."""

import os
import sys


def main() -> None:
    """Entry point of the `mazeplan` command."""
    # most matrices here are small: a second thread of linear algebra waits longer for the first one than it helps
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from mazeplan.apps.cli import main as command
    except KeyboardInterrupt:
        print("mazeplan: interrupted", file=sys.stderr)
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
