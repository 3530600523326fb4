"""With which rig and map a log was recorded, as options of a command that records another."""

from __future__ import annotations

from pathlib import Path

from mazeplan.maze.geometry import Maze

RIG, MAP = "YOUR_RIG", "YOUR_MAP"


def machine_options(log: Path, map_: str | None) -> tuple[list[str], str]:
    """(options, what a person has to fill in of them or nothing) for the rig and map of a log or table; map_: what was
    given with it. The map `cme` is what `collect` takes anyway."""
    from mazeplan.data.runlog import read_log
    from mazeplan.rigs.registry import installed_rigs, rig_names, seeded

    header = read_log(log).header if log.suffix == ".mcap" else {}
    label = str(header.get("rig") or "")
    rig = str(header.get("rig_given") or "")
    if not rig and (":" in label or seeded(label)[0] in (*rig_names(), *installed_rigs())):
        rig = label
    notes = []
    if not rig:
        notes.append(f"{RIG} is the rig of this record" + (f", which the log calls {label}" if label else ""))
    options = ["--rig", rig or RIG]
    name = map_ or _map_of(header)
    if name == MAP:
        notes.append(f"{MAP} is its map, which the log calls {header.get('map_name')}")
    return options + ([] if name == "cme" else ["--map", name]), "; ".join(notes)


def _map_of(header: dict) -> str:
    """The name of a packaged map that is the log's, else what it was given as, else MAP; cme where no map is told."""
    from mazeplan.maze.mapfile import check_text, load_map, packaged_maps

    text = header.get("map")
    maze: Maze | None = check_text(text).maze if isinstance(text, str) else None
    if maze is None:
        return "cme"
    same = (name for name in packaged_maps() if load_map(name) == maze)
    return next(same, "") or str(header.get("map_given") or MAP)
