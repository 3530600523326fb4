"""Ctrl-C while the program is still being loaded."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys


class Interrupted:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt


sys.meta_path.insert(0, Interrupted())
from mazeplan.__main__ import main

main()
"""


def test_ctrl_c_while_it_is_loaded_is_one_line():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "mazeplan: interrupted\n")
