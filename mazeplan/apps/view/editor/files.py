"""Controls of the editor for files and runs: save, begin a new map from a template, try a run.

The editor does not overwrite the work of a person. A new file needs a new name. Before it drops changes that are not
saved, it asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from html import escape
from typing import Any

import numpy as np

from mazeplan.apps.view.editor.mapeditor import MapEditor
from mazeplan.apps.view.editor.scene import EditScene
from mazeplan.apps.view.editor.trial import Trial
from mazeplan.apps.view.page import FONT
from mazeplan.core.errors import MapError
from mazeplan.core.palette import INKS
from mazeplan.maze.mapfile import packaged_maps
from mazeplan.rigs.registry import simulated_rigs

Pressed = Callable[[Callable[[Any], object]], Callable[[Any], None]]
RIG = "toy"  # rig of a trial, until a person selects another
NEW = "new.yaml"


class FileControls:
    """The controls for files and runs.

    pressed: makes a callback from an action of a person
    tell: shows what was done"""

    def __init__(self, editor: MapEditor, pressed: Pressed, tell: Callable[[str], None]) -> None:
        self._editor, self._pressed, self._tell = editor, pressed, tell
        self._asking: dict[int, Any] = {}  # the open question of each browser
        self._trial: Trial | None = None
        self._tried, self._trials = "", 0  # map text of the last trial; number of trials
        self._shown: tuple[Any, ...] = ()

    @property
    def state(self) -> tuple[Any, ...]:
        """The values that `draw` depends on, in addition to the editor."""
        trial = self._trial
        return () if trial is None else (self._trials, trial.said, trial.over)

    def build(self, gui: Any, scene: EditScene) -> None:
        """Add the controls to save, to try a run, and to begin a new map."""
        self._scene = scene
        with gui.add_folder("File"):
            self._name = gui.add_text(
                "Name", self._editor.path.name, hint="another name: a new file in the same folder"
            )
            self._save = gui.add_button("Save", color="green")
            self._again = gui.add_button("Read it again", color="blue", visible=False, hint="Undo brings yours back")
        with gui.add_folder("Try a run"):
            rigs = simulated_rigs()
            self._rig = gui.add_dropdown("Rig", rigs, initial_value=RIG if RIG in rigs else rigs[0])
            self._run = gui.add_button("Save and run", color="blue", hint="from ring 1 to the centre, simulated")
            self._stop = gui.add_button("Stop the run", color="red", visible=False)
            self._outcome = gui.add_html("")
        with gui.add_folder("New map", expand_by_default=False):
            self._template = gui.add_dropdown("Template", packaged_maps())
            self._new_name = gui.add_text("File name", NEW, hint="of a new file in the same folder")
            self._begin = gui.add_button("Begin it", color="blue")
        self._save.on_click(self._pressed(self._write))
        self._again.on_click(self._pressed(lambda event: self._read_again()))
        self._run.on_click(self._pressed(lambda event: self._try()))
        self._stop.on_click(self._pressed(lambda event: self._trial and self._trial.stop()))
        self._begin.on_click(self._pressed(self._new))
        back = gui.add_command("Close the question", hotkey="escape")
        back.on_trigger(lambda event: self._leave(event.client_id))

    def draw(self, overtaken: str) -> None:
        """Update labels, colours, and outcome and path of a trial.

        overtaken: what another program did to the file (`MapEditor.overtaken`)"""
        editor, trial = self._editor, self._trial
        self._save.color = "red" if editor.check.errors else "green" if editor.changed else "gray"
        self._save.label = "Save, with errors …" if editor.check.errors else "Save"
        self._again.visible = overtaken.startswith("was changed")
        running = trial is not None and not trial.over
        self._run.visible, self._stop.visible = not running, running
        self._run.disabled = bool(editor.check.errors)
        self._run.label = "Save and run" if editor.unsaved else "Run"
        shown = (*self.state, editor.text == self._tried)
        if trial is not None and shown != self._shown:
            self._shown = shown
            self._outcome.content = outcome_html(trial)
            self._scene.show_path(trial.path if editor.text == self._tried else np.empty((0, 2)))

    def close(self) -> None:
        """End the run of a trial."""
        if self._trial is not None:
            self._trial.close()

    # -- what a person does -----------------------------------------------------------------------------------------

    def _write(self, event: Any, with_errors: bool = False) -> None:
        errors = self._editor.check.errors
        if errors and not with_errors:
            count = "an error" if len(errors) == 1 else f"{len(errors)} errors"
            self._ask(
                event, f"The map has {count}", map(str, errors[:5]), "Save all the same",
                lambda: self._write(event, with_errors=True),
            )  # fmt: skip
            return
        path = self._editor.save(self._name.value.strip(), with_errors=with_errors)
        self._tell(f"saved as {path.name}")

    def _read_again(self) -> None:
        self._editor.read_again()
        self._tell("")

    def _new(self, event: Any, leave: bool = False) -> None:
        editor, template, name = self._editor, self._template.value, self._new_name.value.strip()
        if editor.changed and not leave:
            why = f"{editor.path.name} has changes that are not saved."
            self._ask(event, "Leave this map?", [why], "Leave them", lambda: self._new(event, leave=True))
            return
        editor.new(template, name)
        self._name.value = editor.path.name
        self._tell(f"new, as the packaged map {template}; Save writes it")

    def _try(self) -> None:
        editor, name = self._editor, self._name.value.strip()
        if self._trial is not None and not self._trial.over:
            raise MapError("a run goes on: stop it first")
        said = ""
        if editor.unsaved or name != editor.path.name:
            said = f"saved as {editor.save(name).name}"
        if what := editor.overtaken():
            raise MapError(f"{what}: read it again, or save it under another name", file=editor.path)
        try:
            self._trial = Trial(editor.path, self._rig.value, self._trials)
        except OSError as problem:
            raise MapError(f"no run could be started: {problem.strerror or problem}") from None
        self._tried, self._trials = editor.text, self._trials + 1
        self._tell(said)

    # -- questions --------------------------------------------------------------------------------------------------

    def _ask(self, event: Any, title: str, rows: Iterable[str], label: str, do: Callable[[], None]) -> None:
        """Ask a question in the browser of the event. The button with this label calls `do`."""
        gui, browser = event.client.gui, event.client.client_id
        self._leave(browser)
        self._asking[browser] = modal = gui.add_modal(title)
        with modal:
            items = "".join(f"<li>{escape(row)}</li>" for row in rows)
            gui.add_html(f'<ul style="{FONT}color:{INKS["bad"]}">{items}</ul>')
            back = gui.add_button("Back to the map")
            anyway = gui.add_button(label, color="red")
        back.on_click(lambda _: self._leave(browser))

        def go_on(pressed: Any) -> None:
            self._leave(browser)
            self._pressed(lambda _: do())(pressed)

        anyway.on_click(go_on)

    def _leave(self, browser: int | None) -> None:
        modal = self._asking.pop(browser, None) if browser is not None else None
        if modal is not None:
            modal.close()


def outcome_html(trial: Trial) -> str:
    """The state or outcome of a trial, and the command that repeats it."""
    sign, ink = ("▶", "running") if not trial.over else ("✓", "good") if trial.arrived else ("✕", "bad")
    return (
        f'<div style="{FONT}" data-trial="{"over" if trial.over else "running"}">'
        f'<div style="color:{INKS[ink]};overflow-wrap:anywhere">{sign} {escape(trial.said)}</div>'
        f'<div style="color:{INKS["quiet"]};overflow-wrap:anywhere">{escape(trial.command)}</div></div>'
    )
