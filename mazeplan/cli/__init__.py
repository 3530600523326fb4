"""The command line. Each command imports what it needs when it runs, so that `--help` answers at once.

Exit status: 0 done, 1 the job ran and did not succeed, 2 bad input or usage (one line), 3 the rig failed, 130 Ctrl-C.
"""

from __future__ import annotations

import sys

from mazeplan.cli.app import app
from mazeplan.errors import MazeplanError


def main() -> None:
    """Entry point of the `mazeplan` command: turns deliberate errors into one line and their exit status."""
    try:
        app()
    except MazeplanError as error:
        print(f"mazeplan: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        print("mazeplan: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output left, as in `mazeplan log export ... | head`
        sys.stderr.close()
        sys.exit(1)
