"""The `mazeplan` command, and `python -m mazeplan`: Ctrl-C is one line while the program is still being loaded, too."""

import gc
import os
import sys


def main() -> None:
    """Entry point of the `mazeplan` command."""
    # most matrices here are small: a second thread of linear algebra waits longer for the first one than it helps
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(50_000, 5, 5)  # modules that are loaded leave no garbage: collecting it takes .1 s
    try:
        from mazeplan.apps.cli import main as command
    except KeyboardInterrupt:
        print("mazeplan: interrupted", file=sys.stderr)
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()
