"""`diagnose`: what a model lacks, by a record."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.arguments import check_channel, check_folder, logged_map
from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

WIDEST = 2.0  # m; of a ring on a table
FEWEST_IN_RINGS = 0.7  # of the samples of a table that knows no rings; a run's own log has passages in it, too

if TYPE_CHECKING:
    import numpy as np

    from mazeplan.data.table import Table
    from mazeplan.diagnosis.diagnose import Diagnosis
    from mazeplan.diagnosis.report import Diagnosed
    from mazeplan.maze.geometry import Maze
    from mazeplan.physics.effect import Effect
    from mazeplan.physics.openings import Openings


def diagnose(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...", help="Run logs (MCAP) or tables (CSV) of one rig; with --system emps a .mat file."
        ),
    ],
    model: Annotated[
        str | None, typer.Option("--model", help="Packaged model or folder: what is known already.")
    ] = None,
    radius: Annotated[
        float | None, typer.Option("--radius", help="Track radius in m: all rows are of one ring.")
    ] = None,
    declare: Annotated[
        list[str] | None,
        typer.Option(
            "--declare",
            metavar="EFFECT.PARAM=VALUE",
            help="What is known already (repeatable); other systems: EFFECT alone is there, and fitted.",
        ),
    ] = None,
    ring: Annotated[
        int | None, typer.Option("--ring", min=1, help="This ring alone; default: all rings, one verdict.")
    ] = None,
    test: Annotated[
        Path | None, typer.Option("--test", help="A further record on which before and after are reported.")
    ] = None,
    map_: Annotated[
        str | None, typer.Option("--map", help="Packaged map or YAML file; default: the log's, else cme.")
    ] = None,
    system: Annotated[
        str,
        typer.Option(
            "--system", help="ring: a ball in its ring; emps: a drive axis, benchmark EMPS; MODULE:CLASS: your own."
        ),
    ] = "ring",
    effects: Annotated[
        str | None,
        typer.Option("--effects", metavar="MODULE:FUNCTION", help="Effects of your own: a function that returns them."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for report.json, report.html and model.")
    ] = None,
    body: Annotated[
        bool, typer.Option("--body", help="What all rings together tell of the ball: friction, walls, camera, table.")
    ] = False,
    reference: Annotated[
        list[Path] | None,
        typer.Option("--reference", help="Log of the same rig when its model was right (repeatable)."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """Find the effect that a model lacks, and say how much better it predicts with it."""
    if system != "ring":
        _of_system(system, logs, declare or [], effects, test, output, as_json,
                   {"--ring": ring, "--radius": radius, "--map": map_, "--model": model,
                    "--reference": reference, "--body": body or None})  # fmt: skip
        return
    alone = {"--ring": ring, "--radius": radius, "--declare": declare}
    given = next((option for option, value in alone.items() if value), None)
    if reference and given:
        raise InputError(f"{given}: got {alone[given]}, expected none with --reference, which uses all rings")
    if body:
        from mazeplan.cli.diagnose_body import diagnose_body

        if reference or given:
            raise InputError(f"--body: got {given or '--reference'} beside it, expected it alone")
        diagnose_body(_single(logs, "--body"), model, map_, output, as_json)
        return
    if given is None:
        from mazeplan.cli.diagnose_body import diagnose_rig
        from mazeplan.data.table import read_table
        from mazeplan.diagnosis.bodyrecord import whole_rig

        tables = [read_table(log) for log in logs]
        if reference or whole_rig(tables):
            diagnose_rig(logs, tables, reference or [], model, map_, test, effects, output, as_json)
            return
    _of_ring(_single(logs, given or "a table without x, y, u_beta and u_gamma"), model, radius, declare or [], ring,
             test, map_, effects, output, as_json)  # fmt: skip


def _single(logs: list[Path], why: str) -> Path:
    """The one log. Raises InputError for more."""
    if len(logs) > 1:
        raise InputError(f"{logs[1]}: got {len(logs)} logs, expected one with {why}")
    return logs[0]


def _of_system(
    system: str, logs: list[Path], declare: list[str], effects: str | None, test: Path | None, output: Path | None,
    as_json: bool, ball: dict[str, Any],
) -> None:  # fmt: skip
    """A system that is no ball in a maze; ball: options that it does not have."""
    from mazeplan.cli.diagnose_mechanism import diagnose_system

    if system != "emps" and ":" not in system:
        raise InputError(f"--system: got {system!r}, expected ring, emps or MODULE:CLASS")
    for option, value in ball.items():
        if value is not None:
            raise InputError(f"{option}: got {value}, expected none with --system {system}: it has no ring")
    diagnose_system(system, _single(logs, f"--system {system}"), declare, effects, test, output, as_json)


def _of_ring(
    log: Path, model: str | None, radius: float | None, declare: list[str], ring: int | None, test: Path | None,
    map_: str | None, effects: str | None, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """A ball in one ring."""
    from mazeplan.cli.machine import machine_options
    from mazeplan.diagnosis.ambiguity import on_machine

    if output is not None:
        check_folder("-o", output)
    done, document = _of_ball(log, model, radius, declare, ring, test, map_, effects)
    if output is not None:
        known, number = document["declared"], document["ring"]
        document["model"] = _new_model(done, model, known, number, logged_map(map_, log)[0], output)
    if document["separate_by"]:
        document["separate_by"] = on_machine(document["separate_by"], *machine_options(log, map_))
    number = document["ring"]
    finish(done, document, output, f"ring {number} of {log.name}" if number else log.name, as_json)


def _of_ball(
    log: Path,
    model: str | None,
    radius: float | None,
    declare: list[str],
    ring: int | None,
    test: Path | None,
    map_: str | None,
    effects: str | None,
) -> tuple[Diagnosis, dict[str, Any]]:
    """Diagnosis of a ball in its ring, and its document."""
    from mazeplan.cli.arguments import positive
    from mazeplan.cli.owneffects import installed_effects, own_effects
    from mazeplan.cli.progress import Working
    from mazeplan.data.table import read_table
    from mazeplan.diagnosis.candidates import ring_library
    from mazeplan.diagnosis.diagnose import diagnose as run
    from mazeplan.diagnosis.parts import Known
    from mazeplan.diagnosis.picture import camera_effects
    from mazeplan.diagnosis.record import centred, record_of, turned_round
    from mazeplan.models.modelfile import load_model
    from mazeplan.physics.openings import Openings, wall_library
    from mazeplan.physics.rig import FAMILY as PARTS
    from mazeplan.physics.sensors import Camera

    own = own_effects(effects)
    installed = installed_effects(e.name for e in own)
    maze, raw = logged_map(map_, log)[0], read_table(log)
    rig = None if model is None else load_model(model)
    was = Camera() if rig is None else rig.camera
    picture, camera = camera_effects(raw, maze, was) if radius is None else (None, was)
    table = centred(raw, camera)
    known: dict[str, dict[str, float]] = {}
    gates = None
    if radius is None:
        number = _ring(table, maze, ring)
        where, rows, gates = maze.track_radius(number), _in_ring(table, maze, number), gates_of(maze, number)
        known = {} if rig is None else rig.declared(number)
    else:
        number, where, rows = ring, positive("--radius", radius), _all(table)
        if where > WIDEST:
            raise InputError(f"--radius: got {radius:g}, expected metres, at most {WIDEST:g}")
        known = {} if rig is None else rig.declared(ring or 1)
    library = [*ring_library(), *wall_library(gates or Openings()), *PARTS]
    own += installed.effects
    installed.check_declared(declare, {c.name for c in (*library, *own)})
    for problem in installed.problems.values():
        say(f"mazeplan: not looked for: {problem}")
    declare_known(known, declare, [*library, *own])
    if radius is None:
        _check_rings(table, maze)
    table, odd = turned_round(table, where)
    further = None
    if test is not None:
        more, _ = turned_round(read_table(test), where)
        further = record_of(more, _all(more) if number is None or radius is not None else _in_ring(more, maze, number))
    ball = record_of(table, rows, odd)
    parts = None if rig is None else Known.of_model(rig)
    as_model = record_of(centred(raw, was), rows) if picture else None
    with Working("diagnosing") as shown:
        done = run(
            ball, where, known, ring=number, gates=gates, more=own, test=further, progress=shown.tell, known=parts,
            camera=picture, as_model=as_model,
        )  # fmt: skip
    document = done.document()
    document["notes"] += [f"looked for {name} of package {of.source}, too" for name, of in installed.owners.items()]
    return done, {
        **document,
        "ring": number,
        "radius_m": where,
        "declared": known,
        "model": None,
        "report": None,
    }


def _new_model(
    done: Diagnosis, model: str | None, known: dict[str, dict[str, float]], ring: int | None, maze: Maze, folder: Path
) -> str | None:
    """The folder of the model with what was found; None where nothing was."""
    from mazeplan.diagnosis.update import base_model, updated
    from mazeplan.models.modelfile import load_model, save_model
    from mazeplan.physics.stage import StageModel

    if not done.effects:
        return None
    stage = None if done.stage is None else StageModel(*done.stage.axes)
    old = base_model(maze, ring, known, stage) if model is None else load_model(model)
    return str(save_model(updated(old, maze, {ring or 1: done.effects}), folder / "model").parent)


def finish(done: Diagnosed, document: dict[str, Any], output: Path | None, title: str, as_json: bool) -> None:
    """Write the report where one is wished, and print what was found."""
    from mazeplan.diagnosis.report import evidence_document
    from mazeplan.report.diagnosis import write_diagnosis

    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        document["report"] = str(output / "report.html")
        (output / "report.json").write_text(json.dumps(document, indent=1) + "\n")
        further = [note for note in document["notes"] if note not in done.remarks]
        evidence = evidence_document(done, title, further)
        (output / "evidence.json").write_text(json.dumps(evidence) + "\n")
        write_diagnosis(document, evidence, output / "report.html")
    if as_json:
        print_json(document)
        return
    ring = document.get("ring")
    print(f"Ring {ring}: {done.sentence()}" if ring else done.sentence())
    for way in document.get("separate_by", []):
        print(f"to tell them apart: {way['first'] + ', then ' if way['first'] else ''}{way['command']}")
    for note in document["notes"]:
        print(f"note: {note}")
    if output is not None:
        print(f"report: {document['report']}")
        if document.get("model") is not None:
            print(f"model:  {document['model']}")


def gates_of(maze: Maze, number: int) -> Openings:
    """Openings in the walls of a ring."""
    from mazeplan.physics.openings import Openings

    openings = maze.openings_of(number)
    return Openings(
        tuple(o.angle for o in openings if o.inner == number), tuple(o.angle for o in openings if o.outer == number)
    )


def _all(table: Table) -> np.ndarray:
    import numpy as np

    return np.ones(len(table), dtype=bool)


def _in_ring(table: Table, maze: Maze, number: int) -> np.ndarray:
    """Rows in which the ball is in the channel of a ring."""
    from mazeplan.models.samples import rings_of

    return rings_of(table, maze) == number


def _check_rings(table: Table, maze: Maze) -> None:
    """Raises InputError for a table that knows no rings and whose radii are not those of the map's: of the little that
    is by chance in a ring nothing could be learned."""
    import numpy as np

    from mazeplan.models.samples import rings_of

    if "ring" in table or "r" not in table:
        return
    seen = np.isfinite(table["r"])
    outside = float(np.mean(rings_of(table, maze)[seen] == 0)) if seen.any() else 1.0
    if outside > 1.0 - FEWEST_IN_RINGS:
        problem = f"the ball is in no ring of the map in {outside:.0%} of the samples that show it"
        raise InputError(f"{problem}; expected --radius M, or another --map")


def _ring(table: Table, maze: Maze, ring: int | None) -> int:
    """The ring asked for, or that of most rows. Raises InputError where there is none, or it has no channel."""
    import numpy as np

    from mazeplan.models.samples import rings_of

    if ring is not None:
        check_channel(ring, maze)
    numbers = rings_of(table, maze)
    found, counts = np.unique(numbers[numbers > 0], return_counts=True)
    if ring is None:
        if not len(found):
            raise InputError("the ball is in no ring of the map; expected --radius M, or another --map")
        ring = int(found[np.argmax(counts)])
        check_channel(ring, maze)
    return ring


def declare_known(
    known: dict[str, dict[str, float]], texts: list[str], candidates: list[Effect], partly: str = ""
) -> None:
    """Add what `--declare` says; partly: an effect of which nothing else is known by that. Raises InputError naming
    what is allowed."""
    library = {c.name: c for c in candidates}
    for text in texts:
        name, equals, value = text.partition("=")
        effect, _, parameter = name.partition(".")
        if not (equals and parameter):
            raise InputError(
                f"--declare: got {text!r}, expected EFFECT.PARAM=VALUE, such as dry_friction.coefficient=0.4"
            )
        if effect not in library:
            raise InputError(f"--declare: got effect {effect!r}, expected one of {', '.join(library)}")
        allowed = library[effect].parameters
        if parameter not in allowed:
            raise InputError(
                f"--declare: got parameter {parameter!r} of {effect}, expected one of {', '.join(allowed)}"
            )
        spec = allowed[parameter]
        try:
            number = float(value)
        except ValueError:
            raise InputError(f"--declare: got {text!r}, expected EFFECT.PARAM=VALUE with a number") from None
        if not (math.isfinite(number) and spec.low <= number <= spec.high):
            raise InputError(f"--declare: got {effect}.{parameter} {number:g}, expected {spec.low:g} to {spec.high:g}")
        had = known.setdefault(effect, {} if effect == partly else {key: s.default for key, s in allowed.items()})
        had[parameter] = number
