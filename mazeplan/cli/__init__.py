"""The command line. Each command imports what it needs when it runs, so that `--help` answers at once.

Exit status: 0 done, 1 the job ran and did not succeed, 2 bad input or usage (one line), 3 the rig failed, 130 Ctrl-C.
"""

from __future__ import annotations

import sys
from typing import Any

import typer

from mazeplan.cli.app import app
from mazeplan.errors import MazeplanError

_UsageError: Any = typer.BadParameter.__base__  # the class is private to typer; its place above BadParameter is not


def main() -> None:
    """Entry point of the `mazeplan` command: turns deliberate errors into one line and their exit status."""
    try:
        status = app(standalone_mode=False)  # or typer would print usage errors itself, over several lines
    except MazeplanError as error:
        print(f"mazeplan: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # a group without a command: its message is the help
            print(error.format_message(), file=sys.stderr)
        else:
            print(f"mazeplan: {' '.join(error.format_message().split())}", file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        print("mazeplan: interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output left, as in `mazeplan log export ... | head`
        sys.stderr.close()
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)
