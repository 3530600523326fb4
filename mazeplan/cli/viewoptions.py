"""Options of the commands that open a page."""

from __future__ import annotations

from typing import Annotated

import typer

HOST, PORT = "127.0.0.1", 8080
Host = Annotated[
    str, typer.Option("--host", help="Address of the page; another than the loopback needs the token of its URL.")
]
PagePort = Annotated[int, typer.Option("--port", help="Port of the page; 0: any that is free.")]
