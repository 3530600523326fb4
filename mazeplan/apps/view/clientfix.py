"""A script and a style sheet in front of viser's client. They correct what the client does wrong in a browser.

Pointers: viser's scene registers passive listeners, which promise never to prevent the browser's default action. Where
something can be dragged they prevent it all the same; the browser refuses, with an error in its console at each drag.
The script removes the promise before the client makes it. (The promise only makes scrolling by touch or wheel faster.)

Arrow keys: they turn viser's camera even where they have another meaning. A replay steps with them, and a turned view
is no longer fitted. viser listens for command keys at the root of the document, and for camera keys at the document,
which comes after the root. The script stops an arrow key between the two. A person turns the view with the pointer.

Panels: a scrollbar would cover the content of its panel; the style sheet gives it room. In a narrow window the script
folds the panel at the left, until a person unfolds it. viser warns of drawing in software, which a user cannot change;
the script hides from viser which device draws.

Access: viser gives no names to its icons and to the number beside a slider. The script names them for people who do not
see them. The Tab key reaches everything that scrolls, so that keys can scroll it.

The emergency stop of a live page is a bar above viser's client. It is no part of the client: no panel covers, scrolls
or folds it. The bar and the Escape key trigger viser's command for Escape, also while a text field has the focus.
"""

from __future__ import annotations

import gzip
from functools import lru_cache
from typing import Any

from mazeplan.core.palette import FAINT, INKS, STOP, TINTS

NARROW = 900  # pixels of a window; in a narrower one two panels leave little room for the maze
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
  for (const kind of [window.WebGLRenderingContext, window.WebGL2RenderingContext]) {
    if (!kind) continue;
    const extension = kind.prototype.getExtension;
    kind.prototype.getExtension = function (name) {
      return name === "WEBGL_debug_renderer_info" ? null : extension.call(this, name);
    };
  }
  const narrow = matchMedia("(max-width: NARROWpx)");
  let folded = false;
  const fit = tries => {
    const kind = narrow.matches ? "region-collapse" : "minimize-all";  // of the panels at the left, or of their rail
    const button = document.querySelector(`[data-dock-region="left"] [data-dock-${kind}]`);
    if (!button) return tries && setTimeout(fit, 100, tries - 1);
    if (narrow.matches || folded) button.click();
    folded = narrow.matches;
  };
  add.call(window, "load", () => narrow.matches && fit(300));
  add.call(narrow, "change", () => fit(0));
  const name = () => {
    document.title = "mazeplan";
    for (const [icon, label] of [["list-search", "Commands"], ["adjustments", "Scene and settings of the page"]])
      for (const button of document.querySelectorAll(`button:has(.tabler-icon-${icon}):not([aria-label])`))
        button.setAttribute("aria-label", label);
    for (const part of document.querySelectorAll(".mantine-ScrollArea-viewport:not([tabindex])")) part.tabIndex = 0;
    for (const field of document.querySelectorAll("input, textarea, [role=slider]")) {
      if (field.ariaLabel || (field.labels && field.labels.length && field.labels[0].innerText)) continue;
      let row = field.parentElement, words = "";
      const named = row => row.matches(".mantine-Flex-root") && row.firstElementChild.innerText.trim();
      while (row && !/[a-z]/i.test(words = named(row) || ""))  // numbers are the ends of a slider
        row = row.parentElement;
      field.ariaLabel = words || "Text";
    }
  };
  let waits = false;
  new MutationObserver(() => {
    if (!waits) waits = setTimeout(() => { waits = false; name(); }, 500);
  }).observe(document, {childList: true, subtree: true});
}
</script>
<style>
.mantine-ScrollArea-viewport > div {box-sizing: border-box; padding-right: 9px}
body {display: flex; flex-direction: column}
#root {flex: 1; min-height: 0; height: auto}
#stop-bar {display: flex; align-items: center; gap: 12px; padding: 4px 12px; border-bottom: 1px solid RULE;
  font-size: 13px; background: PAPER; color: INK}
#stop-bar button {font: bold 15px sans-serif; color: PAPER; background: FACE; border: 2px solid PRESSED;
  border-radius: 4px; padding: 6px 18px; cursor: pointer; white-space: nowrap}
#stop-bar button:active {background: PRESSED}
#stop-bar kbd {font: inherit; border: 1px solid PAPER; border-radius: 3px; padding: 0 5px; margin-left: 8px}
</style>""".replace("NARROW", str(NARROW))
for _name, _colour in {
    "RULE": FAINT["rule"], "PAPER": TINTS["paper"], "INK": INKS["ink"], "FACE": STOP["face"],
    "PRESSED": STOP["pressed"],
}.items():  # fmt: skip
    SCRIPT = SCRIPT.replace(_name, _colour)
PLACE, ROOT = b"<head>", b'<div id="root">'  # the script follows PLACE, the bar precedes ROOT
STOP_BAR = """<header id="stop-bar">
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


def mended(response: Any, bar: str = "") -> None:
    """If viser's answer is its page, put the script, and the bar above the client, into it.

    response: an answer of websockets, changed in place
    bar: HTML"""
    if not response.body or not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    response.body = _with_script(response.body, response.headers.get("Content-Encoding") == "gzip", bar)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=2)  # the page has 0.6 MB, and each browser asks for it
def _with_script(body: bytes, packed: bool, bar: str) -> bytes:
    page = (gzip.decompress(body) if packed else body).replace(PLACE, PLACE + SCRIPT.encode(), 1)
    before, root, after = page.rpartition(ROOT)
    page = before + bar.encode() + root + after
    return gzip.compress(page, mtime=0) if packed else page
