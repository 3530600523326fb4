"""A few lines of our own in front of viser's client, for what it does wrong in a browser.

Its scene listens to pointers by listeners that promise never to prevent what a browser does by itself, and then
prevents it wherever something can be dragged: the browser refuses, with an error in its console at each drag. Here the
promise is taken out before the client makes it. (Only scrolling by touch or wheel is the faster for such a promise.)

Arrow keys turn its camera, wherever else they mean something: a replay steps by them, and a view that was turned is no
longer fitted. Its keys for commands are listened for at the root of the document, the camera's at the document, which
comes after it: an arrow is stopped between them. The view is turned by the pointer.

The scrollbar of a panel would cover its content, and gets room of its own.
"""

from __future__ import annotations

import gzip
from functools import lru_cache
from typing import Any

SCRIPT = """<script>
{
  const add = EventTarget.prototype.addEventListener;
  EventTarget.prototype.addEventListener = function (kind, listener, options) {
    const promised = options && options.passive && String(kind).startsWith("pointer");
    return add.call(this, kind, listener, promised ? {...options, passive: false} : options);
  };
  add.call(document.documentElement, "keydown", event => {
    if (event.key.startsWith("Arrow")) event.stopPropagation();
  });
}
</script>
<style>.mantine-ScrollArea-viewport > div {box-sizing: border-box; padding-right: 9px}</style>"""
PLACE = b"<head>"  # the script is the first thing after it


def mended(response: Any) -> None:
    """Put the script into viser's answer (of websockets) where that is its page."""
    if not response.body or not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    response.body = _with_script(response.body, response.headers.get("Content-Encoding") == "gzip")
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=2)  # of 0.6 MB, asked for by each browser that comes
def _with_script(body: bytes, packed: bool) -> bytes:
    page = (gzip.decompress(body) if packed else body).replace(PLACE, PLACE + SCRIPT.encode(), 1)
    return gzip.compress(page, mtime=0) if packed else page
