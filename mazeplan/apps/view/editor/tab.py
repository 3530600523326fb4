"""The tab in which a map is edited: the maze to drag in, its YAML with all errors, and buttons."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from threading import RLock
from time import monotonic
from typing import Any

from mazeplan.apps.view.editor.listing import changed_lines, listing
from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.editor.scene import EditScene, Phase
from mazeplan.apps.view.page import FONT, Page, pressed
from mazeplan.core.errors import MapError
from mazeplan.core.palette import INKS

TEXT_WIDTH = 400  # pixels of the panel with the YAML: a line of maps/cme.yaml with an opening
LOOK_S = 1.0  # between looks at the file
PAUSE_S = 1.0  # in typing, after which a further step begins that can be undone
TYPED = (
    ".mantine-Textarea-input{min-height:65vh!important;white-space:pre!important;overflow:auto!important;"
    "font-size:11px!important;font-family:ui-monospace,Menlo,Consolas,monospace!important}"
    # and keeps room for a label beside them
    ".mantine-Flex-root:has(> * .mantine-Textarea-input) > :first-child:not(:has(textarea)){display:none}"
)


class EditTab:
    """See `page.Tab`. Browsers change the editor, under a lock; `draw` shows it."""

    def __init__(self, editor: MapEditor) -> None:
        self._editor, self._lock = editor, RLock()
        self._chosen: int | None = editor.openings[0].index if editor.openings else None
        self._refused = ""  # why the last action was refused
        self._said = ""
        self._typed_at = 0.0
        self._overtaken, self._looked_at = "", 0.0  # what another program did to the file, and when we looked
        self._asking: dict[int, Any] = {}  # by browser: the question that is open there
        self._drawn: tuple[Any, ...] = ()

    # -- the page ---------------------------------------------------------------------------------------------------

    def build(self, page: Page) -> None:
        """Scene, text, buttons."""
        self._page, gui = page, page.server.gui
        self._scene = EditScene(page, self._drag, self._choose)
        panel = gui.add_panel()
        with panel.add_tab("YAML"):
            self._listing = gui.add_html("")
        with panel.add_tab("Type"):
            # viser makes fields of text a few lines high
            said = "The maze shows what you type at once, as long as it has no errors."
            gui.add_html(f'<style>{TYPED}</style><div style="{FONT}color:{INKS["quiet"]}">{said}</div>')
            self._typed = gui.add_text("", _plain(self._editor.text), multiline=True)
            self._typed.on_update(self._pressed(lambda event: self._type(event.target.value)))
            self._beside = gui.add_html("")
        panel.dock_left()
        panel.set_width(TEXT_WIDTH)
        with page.tabs.add_tab("Map"):
            self._head = gui.add_html("")
            self._build_opening(gui)
            self._build_steps(gui)
            self._build_file(gui)
            self._help = gui.add_html(
                f'<div style="{FONT}color:{INKS["quiet"]}">Drag a block along its wall, click one to choose it. '
                "In the maze a drag moves openings only; outside it turns the view. Ctrl Z: undo, ctrl Y: redo.</div>"
            )

    def _build_opening(self, gui: Any) -> None:
        with gui.add_folder("Opening"):
            self._which = gui.add_dropdown("Chosen", self._names(), hint="or click it in the maze")
            self._angle = gui.add_slider("Angle, degrees", 0.0, 359.9, 0.1, 0.0)
            self._width = gui.add_slider("Width (mm)", 1.0, 60.0, 0.05, 15.0)
            self._closed = gui.add_checkbox("Closed", False, hint="it is there, but no route uses it")
            self._remove = gui.add_button("Remove it", color="gray", hint="a comment on its line stays")
        self._which.on_update(self._pressed(lambda event: self._choose_name(event.target.value)))
        self._angle.on_update(self._pressed(lambda event: self._slide(event.target.value, "move")))
        self._width.on_update(self._pressed(lambda event: self._slide(event.target.value, "widen")))
        self._closed.on_update(self._pressed(lambda event: self._close(event.target.value)))
        self._remove.on_click(self._pressed(lambda event: self._take_out()))

    def _build_steps(self, gui: Any) -> None:
        with gui.add_folder("New opening"):
            self._wall = gui.add_dropdown("Wall between rings", self._walls())
            self._add = gui.add_button("Add", color="blue", hint="in the middle of the longest piece of that wall")
        self._add.on_click(self._pressed(lambda event: self._put_in()))
        self._undo = gui.add_button("Undo", color="gray")
        self._redo = gui.add_button("Redo", color="gray")
        for button, step, key in ((self._undo, self._editor.undo, "Z"), (self._redo, self._editor.redo, "Y")):
            button.on_click(self._pressed(lambda event, step=step: step()))
            command = gui.add_command(button.label, hotkey=key, modifier="cmd/ctrl")
            command.on_trigger(self._pressed(lambda event, step=step: step()))

    def _build_file(self, gui: Any) -> None:
        with gui.add_folder("File"):
            self._name = gui.add_text(
                "Name", self._editor.path.name, hint="another name: a new file in the same folder"
            )
            self._save = gui.add_button("Save", color="green")
            self._again = gui.add_button("Read it again", color="blue", visible=False, hint="Undo brings yours back")
        self._save.on_click(self._pressed(lambda event: self._write(event)))
        self._again.on_click(self._pressed(lambda event: self._read_again()))
        back = gui.add_command("Close the question", hotkey="escape")
        back.on_trigger(lambda event: self._leave(event.client_id))

    def _pressed(self, do: Callable[[Any], object]) -> Callable[[Any], None]:
        """A callback for a person's action; the page shows why an action is refused."""

        def attempt(event: Any) -> None:
            self._refused = self._said = ""
            try:
                do(event)
            except MapError as problem:
                self._refused = str(problem)

        return pressed(self._lock, attempt)

    # -- what a person does -----------------------------------------------------------------------------------------

    def _drag(self, index: int, angle_deg: float, phase: Phase) -> None:
        with self._lock:
            self._chosen, self._refused, self._said = index, "", ""
            try:
                self._editor.move(index, angle_deg, gesture="drag")
            except MapError as problem:
                self._refused = str(problem)
            if phase == "end":
                self._editor.settle()

    def _choose(self, index: int) -> None:
        with self._lock:
            self._chosen = index

    def _choose_name(self, name: str) -> None:
        self._chosen = next((o.index for o in self._editor.openings if o.name == name), self._chosen)

    def _slide(self, value: float, what: str) -> None:
        opening = None if self._chosen is None else self._editor.opening(self._chosen)
        if opening is None:
            return
        if what == "move" and value != opening.angle_deg:
            self._editor.move(opening.index, value, gesture=("angle", opening.index))
        elif what == "widen" and value != opening.width_mm:
            self._editor.widen(opening.index, value, gesture=("width", opening.index))

    def _close(self, closed: bool) -> None:
        if self._chosen is not None:
            self._editor.close(self._chosen, closed)

    def _take_out(self) -> None:
        if self._chosen is not None:
            self._editor.remove(self._chosen)
            self._chosen = min(self._chosen, len(self._editor.openings) - 1) if self._editor.openings else None

    def _put_in(self) -> None:
        self._chosen = self._editor.add(int(self._wall.value.split("–")[0]))

    def _type(self, text: str) -> None:
        self._typed_at = monotonic()
        self._editor.write(text)

    def _write(self, event: Any, with_errors: bool = False) -> None:
        errors = self._editor.check.errors
        if errors and not with_errors:
            self._ask(event)
            return
        path = self._editor.save(self._name.value.strip(), with_errors=with_errors)
        self._said = f"saved as {path}"

    def _read_again(self) -> None:
        self._editor.read_again()
        self._looked_at = 0.0

    def _leave(self, browser: int | None) -> None:
        modal = self._asking.pop(browser, None) if browser is not None else None
        if modal is not None:
            modal.close()

    def _ask(self, event: Any) -> None:
        """Ask in the browser of the event whether to save with errors."""
        errors = self._editor.check.errors
        count = "an error" if len(errors) == 1 else f"{len(errors)} errors"
        browser = event.client.client_id
        self._leave(browser)
        self._asking[browser] = modal = event.client.gui.add_modal(f"The map has {count}")
        with modal:
            rows = "".join(f"<li>{escape(str(error))}</li>" for error in errors[:5])
            event.client.gui.add_html(f'<ul style="{FONT}color:{INKS["bad"]}">{rows}</ul>')
            back = event.client.gui.add_button("Back to the map")
            anyway = event.client.gui.add_button("Save all the same", color="red", hint="no run will take it as it is")
        back.on_click(lambda _: self._leave(browser))

        def save(pressed: Any) -> None:
            self._leave(browser)
            self._pressed(lambda _: self._write(event, with_errors=True))(pressed)

        anyway.on_click(save)

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
                editor.text, editor.path, editor.changed, self._chosen, self._refused, self._said, self._overtaken
            )  # fmt: skip
            if state == self._drawn:
                return
            if self._chosen is not None and editor.opening(self._chosen) is None and editor.openings:
                self._chosen = editor.openings[0].index
            self._drawn = state
            self._scene.show(editor, self._chosen)
            self._draw_text()
            self._draw_buttons()
            self._head.content = head_html(editor, self._refused, self._said, self._overtaken)

    def _draw_text(self) -> None:
        editor = self._editor
        opening = None if self._chosen is None else editor.opening(self._chosen)
        changed = changed_lines(editor.saved, editor.text)
        self._listing.content = listing(
            editor.text, editor.check.errors, None if opening is None else opening.line, changed
        )
        self._beside.content = problems_html(editor)
        if self._typed.value != _plain(editor.text):
            self._typed.value = _plain(editor.text)

    def _draw_buttons(self) -> None:
        editor, names = self._editor, self._names()
        opening = None if self._chosen is None else editor.opening(self._chosen)
        if self._which.options != names:
            self._which.options = names
        walls = self._walls()
        if self._wall.options != walls:
            self._wall.options = walls
        for control in (self._which, self._angle, self._width, self._closed, self._remove):
            control.disabled = opening is None
        if opening is not None:
            self._which.value = opening.name
            self._angle.value = min(round(opening.angle_deg, 1), 359.9)
            self._width.value = min(max(opening.width_mm, 1.0), 60.0)
            self._closed.value = opening.closed
        self._undo.disabled, self._redo.disabled = not editor.can_undo, not editor.can_redo
        self._save.color = "red" if editor.check.errors else "green" if editor.changed else "gray"
        self._save.label = "Save, with errors …" if editor.check.errors else "Save"
        self._again.visible = self._overtaken.startswith("was changed")
        self._add.disabled = editor.maze is None

    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(opening.name for opening in self._editor.openings)) or ("none",)

    def _walls(self) -> tuple[str, ...]:
        rings = 0 if self._editor.maze is None else len(self._editor.maze.rings)
        return tuple(f"{outer}–{outer + 1}" for outer in range(1, rings)) or ("none",)


def _plain(text: str) -> str:
    """As a browser has it in a field of text."""
    return re.sub("\r\n?", "\n", text)


def head_html(editor: MapEditor, refused: str, said: str, overtaken: str = "") -> str:
    """The file, whether it is saved, whether it has errors."""
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
        f'<div style="{FONT}" data-changed="{int(editor.changed)}" data-errors="{wrong}">'
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
