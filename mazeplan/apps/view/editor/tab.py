"""The tab of the map editor: the maze with parts to drag, the YAML with all errors, and buttons."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from threading import RLock
from time import monotonic
from typing import Any

from mazeplan.apps.view.editor.files import FileControls
from mazeplan.apps.view.editor.listing import changed_lines, listing
from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.editor.scene import EditScene, Key, Phase
from mazeplan.apps.view.page import FONT, Page, pressed
from mazeplan.core.errors import MapError
from mazeplan.core.palette import INKS
from mazeplan.maze.mapedit import Section, Written

TEXT_WIDTH = 400  # pixels of the panel with the YAML: as wide as a line of maps/cme.yaml with an opening
LOOK_S = 1.0  # s between looks at the file
PAUSE_S = 1.0  # s; after a longer pause in typing, a new step to undo begins
KINDS: dict[str, Section] = {"opening": "openings", "radial wall": "radial_walls", "ring": "rings"}
TYPED = (
    ".mantine-Textarea-input{min-height:65vh!important;white-space:pre!important;overflow:auto!important;"
    "font-size:11px!important;font-family:ui-monospace,Menlo,Consolas,monospace!important}"
    # hides the room that viser keeps for a label beside the text field
    ".mantine-Flex-root:has(> * .mantine-Textarea-input) > :first-child:not(:has(textarea)){display:none}"
)


class EditTab:
    """See `page.Tab`. Browsers change the editor under a lock, and `draw` shows the editor."""

    def __init__(self, editor: MapEditor) -> None:
        self._editor, self._lock = editor, RLock()
        self._chosen: Key | None = _key(editor.pieces[0]) if editor.pieces else None
        self._refused = ""  # why the last action was refused
        self._said = ""
        self._typed_at = 0.0
        self._overtaken, self._looked_at = "", 0.0  # what another program did to the file; time of the last look
        self._drawn: tuple[Any, ...] = ()
        self._files = FileControls(editor, self._pressed, self._tell)

    # -- the page ---------------------------------------------------------------------------------------------------

    def build(self, page: Page) -> None:
        """Add scene, text and buttons to the page."""
        gui = page.server.gui
        self._scene = EditScene(page, self._drag, self._choose)
        panel = gui.add_panel()
        with panel.add_tab("YAML"):
            self._listing = gui.add_html("")
        with panel.add_tab("Type"):
            # without the style, viser makes text fields only a few lines high
            said = "The maze shows what you type at once, as long as it has no errors."
            gui.add_html(f'<style>{TYPED}</style><div style="{FONT}color:{INKS["quiet"]}">{said}</div>')
            self._typed = gui.add_text("", _plain(self._editor.text), multiline=True)
            self._typed.on_update(self._pressed(lambda event: self._type(event.target.value)))
            self._beside = gui.add_html("")
        panel.dock_left()
        panel.set_width(TEXT_WIDTH)
        with page.tabs.add_tab("Map"):
            self._head = gui.add_html("")
            self._build_chosen(gui)
            self._build_steps(gui)
            self._files.build(gui, self._scene)
            self._help = gui.add_html(
                f'<div style="{FONT}color:{INKS["quiet"]}">Drag an opening or a radial wall along its ring. Click it, '
                "or the floor of a ring, to choose it. Drag outside the maze to turn the view. Ctrl Z: undo, "
                "ctrl Y: redo.</div>"
            )

    def _build_chosen(self, gui: Any) -> None:
        with gui.add_folder("Chosen"):
            self._which = gui.add_dropdown("Part", self._names(), hint="or click it in the maze")
            self._angle = gui.add_slider("Angle (deg)", 0.0, 359.9, 0.1, 0.0)
            self._width = gui.add_slider("Width (mm)", 1.0, 60.0, 0.05, 15.0, hint="of a radial wall: its thickness")
            self._closed = gui.add_checkbox("Closed", False, hint="it is there, but no route uses it")
            self._remove = gui.add_button("Remove it", color="gray", hint="a comment on its line stays")
        self._which.on_update(self._pressed(lambda event: self._choose_name(event.target.value)))
        self._angle.on_update(self._pressed(lambda event: self._slide(event.target.value, "move")))
        self._width.on_update(self._pressed(lambda event: self._slide(event.target.value, "widen")))
        self._closed.on_update(self._pressed(lambda event: self._close(event.target.value)))
        self._remove.on_click(self._pressed(lambda event: self._take_out()))

    def _build_steps(self, gui: Any) -> None:
        with gui.add_folder("New part"):
            self._what = gui.add_dropdown("What", tuple(KINDS))
            self._where = gui.add_dropdown("Where", self._places())
            self._add = gui.add_button("Add", color="blue", hint="where there is most room")
        self._add.on_click(self._pressed(lambda event: self._put_in()))
        self._undo = gui.add_button("Undo", color="gray")
        self._redo = gui.add_button("Redo", color="gray")
        for button, step, key in ((self._undo, self._editor.undo, "Z"), (self._redo, self._editor.redo, "Y")):
            button.on_click(self._pressed(lambda event, step=step: step()))
            command = gui.add_command(button.label, hotkey=key, modifier="cmd/ctrl")
            command.on_trigger(self._pressed(lambda event, step=step: step()))

    def close(self) -> None:
        """End the run of a trial."""
        self._files.close()

    def _pressed(self, do: Callable[[Any], object]) -> Callable[[Any], None]:
        """A callback for an action of a person. If the editor refuses the action, the page shows why."""

        def attempt(event: Any) -> None:
            self._refused = self._said = ""
            try:
                do(event)
            except MapError as problem:
                self._refused = str(problem)

        return pressed(self._lock, attempt)

    def _tell(self, said: str) -> None:
        self._said, self._looked_at = said, 0.0

    # -- what a person does -----------------------------------------------------------------------------------------

    def _drag(self, key: Key, angle_deg: float, phase: Phase) -> None:
        with self._lock:
            self._chosen, self._refused, self._said = key, "", ""
            try:
                self._editor.move(key[1], angle_deg, gesture="drag", section=key[0])
            except MapError as problem:
                self._refused = str(problem)
            if phase == "end":
                self._editor.settle()

    def _choose(self, key: Key) -> None:
        with self._lock:
            self._chosen = key

    def _choose_name(self, name: str) -> None:
        self._chosen = next((_key(piece) for piece in self._editor.pieces if piece.name == name), self._chosen)

    @property
    def _piece(self) -> Written | None:
        return None if self._chosen is None else self._editor.piece(*self._chosen)

    def _slide(self, value: float, what: str) -> None:
        piece = self._piece
        if piece is None or piece.section == "rings":
            return
        if what == "move" and value != piece.angle_deg:
            self._editor.move(piece.index, value, gesture=("angle", _key(piece)), section=piece.section)
        elif what == "widen" and value != piece.width_mm:
            self._editor.widen(piece.index, value, gesture=("width", _key(piece)), section=piece.section)

    def _close(self, closed: bool) -> None:
        if (piece := self._piece) is not None and piece.section == "openings":
            self._editor.close(piece.index, closed)

    def _take_out(self) -> None:
        if (piece := self._piece) is not None:
            self._editor.remove(piece.index, piece.section)
            left = [*self._editor.of(piece.section)[: piece.index + 1][-1:], *self._editor.pieces]
            self._chosen = _key(left[0]) if left else None

    def _put_in(self) -> None:
        number = int(re.findall(r"\d+", self._where.value)[0])
        section = KINDS[self._what.value]
        add = {"openings": self._editor.add, "radial_walls": self._editor.add_wall, "rings": self._editor.add_ring}
        self._chosen = (section, add[section](number))

    def _type(self, text: str) -> None:
        self._typed_at = monotonic()
        self._editor.write(text)

    # -- what is shown ----------------------------------------------------------------------------------------------

    def draw(self, now: float) -> None:
        """Draw changes."""
        with self._lock:
            editor = self._editor
            if self._typed_at and now - self._typed_at > PAUSE_S:
                self._typed_at = 0.0
                editor.settle()
            if now - self._looked_at > LOOK_S:
                self._looked_at, self._overtaken = now, editor.overtaken()
            state = (
                editor.text, editor.path, editor.changed, self._chosen, self._refused, self._said, self._overtaken,
                self._what.value, self._files.state,
            )  # fmt: skip
            if state == self._drawn:
                return
            if self._piece is None and editor.pieces:
                self._chosen = _key(editor.pieces[0])
            self._drawn = state
            self._scene.show(editor, self._chosen)
            self._draw_text()
            self._draw_buttons()
            self._files.draw(self._overtaken)
            self._head.content = head_html(editor, self._refused, self._said, self._overtaken)

    def _draw_text(self) -> None:
        editor, piece = self._editor, self._piece
        changed = changed_lines(editor.saved, editor.text)
        self._listing.content = listing(
            editor.text, editor.check.errors, None if piece is None else piece.line, changed
        )
        self._beside.content = problems_html(editor)
        if self._typed.value != _plain(editor.text):
            self._typed.value = _plain(editor.text)

    def _draw_buttons(self) -> None:
        editor, piece = self._editor, self._piece
        for control, options in ((self._which, self._names()), (self._where, self._places())):
            if control.options != options:
                control.options = options
        turns = piece is not None and piece.section != "rings"
        self._which.disabled = self._remove.disabled = piece is None
        self._angle.disabled = self._width.disabled = not turns
        self._closed.disabled = piece is None or piece.section != "openings"
        if piece is not None:
            self._which.value = piece.name
            self._angle.value = min(round(piece.angle_deg, 1), 359.9)
            self._width.value = min(max(piece.width_mm, 1.0), 60.0)
            self._closed.value = piece.closed
        self._undo.disabled, self._redo.disabled = not editor.can_undo, not editor.can_redo
        self._add.disabled = editor.maze is None or self._where.options == ("none",)

    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(piece.name for piece in self._editor.pieces)) or ("none",)

    def _places(self) -> tuple[str, ...]:
        """Where a part of the chosen kind can be added."""
        rings, section = 0 if self._editor.maze is None else len(self._editor.maze.rings), KINDS[self._what.value]
        words = {"openings": "wall {}–{}", "radial_walls": "ring {}", "rings": "outside ring {}"}[section]
        last = rings if section == "rings" else rings - 1
        return tuple(words.format(ring, ring + 1) for ring in range(1, last + 1)) or ("none",)


def _key(piece: Written) -> Key:
    return piece.section, piece.index


def _plain(text: str) -> str:
    """The text with the line ends that a browser uses in a text field."""
    return re.sub("\r\n?", "\n", text)


def head_html(editor: MapEditor, refused: str, said: str, overtaken: str = "") -> str:
    """The name of the file, whether the text is saved, whether it has errors, and messages."""
    state = "changed, not saved" if editor.changed else "as in the file"
    if overtaken:
        state = f"the file {overtaken}" + (", and yours is not saved" if editor.changed else "")
    wrong = len(editor.check.errors)
    word = "no errors" if not wrong else f"{wrong} error{'' if wrong == 1 else 's'}: see the lines marked ✕ under YAML"
    colour = INKS["bad" if wrong else "good"]
    notes = "".join(f'<div style="color:{INKS["unsure"]}">{escape(text)}</div>' for text in editor.check.warnings)
    bad = f'<div data-refused style="color:{INKS["bad"]};font-weight:600">{escape(refused)}</div>' if refused else ""
    good = f'<div data-said style="color:{INKS["good"]}">{escape(said)}</div>' if said else ""
    return (
        f'<div style="{FONT}overflow-wrap:anywhere" data-changed="{int(editor.changed)}" data-errors="{wrong}">'
        f'<b>{escape(editor.path.name)}</b> <span style="color:{INKS["quiet"]}">{state}</span>'
        f'<div style="color:{colour}">{"✕" if wrong else "✓"} {word}</div>'
        f"{notes}{bad}{good}</div>"
    )


def problems_html(editor: MapEditor) -> str:
    """All errors with their lines, beside the typed text."""
    rows = [*editor.text.splitlines(), ""]
    shown = []
    for error in editor.check.errors:
        line = min(error.line or 1, len(rows))
        shown.append(
            f'<div style="color:{INKS["bad"]};margin-top:4px"><b>line {line}</b> '
            f"{escape(f'{error.key}: ' if error.key else '')}{escape(error.problem)}"
            f'<div style="color:{INKS["quiet"]};white-space:pre;overflow:hidden">'
            f"{escape(rows[line - 1].strip())}</div></div>"
        )
    return f'<div style="{FONT}">{"".join(shown) or "no errors"}</div>'
