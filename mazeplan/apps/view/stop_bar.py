"""The bar with the emergency stop above viser's client, and what is put in front of the client.

The bar is no part of the client: no panel covers, scrolls or folds it. The bar and the Escape key trigger viser's
command for Escape, also while a text field has the focus.

Arrow keys turn viser's camera even where they have another meaning; a replay steps with them. viser listens for command
keys at the root of the document, and for camera keys at the document, which comes after the root. A script stops an
arrow key between the two.
"""

from __future__ import annotations

import gzip
from functools import lru_cache
from typing import Any

from mazeplan.core.palette import FAINT, INKS, STOP, TINTS

ARROWS = """<script>
document.documentElement.addEventListener("keydown", event => {
  if (event.key.startsWith("Arrow")) event.stopPropagation();
});
</script>"""
STOP_BAR = """<style>
body {display: flex; flex-direction: column}
#root {flex: 1; min-height: 0; height: auto}
#stop-bar {display: flex; align-items: center; gap: 12px; padding: 4px 12px; border-bottom: 1px solid RULE;
  font-size: 13px; background: PAPER; color: INK}
#stop-bar button {font: bold 15px sans-serif; color: PAPER; background: FACE; border: 2px solid PRESSED;
  border-radius: 4px; padding: 6px 18px; cursor: pointer; white-space: nowrap}
#stop-bar button:active {background: PRESSED}
#stop-bar kbd {font: inherit; border: 1px solid PAPER; border-radius: 3px; padding: 0 5px; margin-left: 8px}
</style>
<header id="stop-bar">
<button id="emergency-stop" type="button" aria-keyshortcuts="Escape">Emergency stop <kbd>Esc</kbd></button>
<span>The plate goes level at once, and the run ends.</span>
<script>
{
  const press = () => document.documentElement.dispatchEvent(
    new KeyboardEvent("keydown", {key: "Escape", code: "Escape", bubbles: true}));
  const button = document.getElementById("emergency-stop");
  button.addEventListener("click", press);
  addEventListener("keydown", event => {
    if (event.isTrusted && event.key === "Escape" && !event.repeat) press();
  }, true);
  document.documentElement.addEventListener("keydown", event => {
    if (event.isTrusted && event.key === "Escape") event.stopImmediatePropagation();
  });
}
</script>
</header>
"""
for _name, _colour in {
    "RULE": FAINT["rule"], "PAPER": TINTS["paper"], "INK": INKS["ink"], "FACE": STOP["face"],
    "PRESSED": STOP["pressed"],
}.items():  # fmt: skip
    STOP_BAR = STOP_BAR.replace(_name, _colour)
PLACE, ROOT = b"<head>", b'<div id="root">'  # the script follows PLACE, the bar precedes ROOT


def add_bar(response: Any, bar: str = "") -> None:
    """If viser's answer is its page, put the script, and the bar above the client, into it.

    response: an answer of websockets, changed in place
    bar: HTML"""
    if not response.body or not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    response.body = _with_bar(response.body, response.headers.get("Content-Encoding") == "gzip", bar)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=2)  # the page has 0.6 MB, and each browser asks for it
def _with_bar(body: bytes, packed: bool, bar: str) -> bytes:
    page = (gzip.decompress(body) if packed else body).replace(PLACE, PLACE + ARROWS.encode(), 1)
    before, root, after = page.rpartition(ROOT)
    page = before + bar.encode() + root + after
    return gzip.compress(page, mtime=0) if packed else page
