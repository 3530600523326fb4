"""`behavior check`, `show`, `list` and `palette`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say, write_text
from mazeplan.core.errors import TreeError

if TYPE_CHECKING:
    from mazeplan.behavior.leaf import Leaf
    from mazeplan.behavior.ports import Port
    from mazeplan.behavior.tree import BehaviorTree
    from mazeplan.maze.geometry import Maze

app = typer.Typer(help="Check and show behaviour trees; list leaves.", no_args_is_help=True)

Trees = Annotated[list[str], typer.Argument(help="XML files, or names of packaged trees.")]
Tree = Annotated[str, typer.Argument(help="XML file, or name of a packaged tree.")]
CheckedMap = Annotated[
    str | None, typer.Option("--map", help="Map whose rings and openings the tree may name. Default: any names.")
]
Drawing = Annotated[Path | None, typer.Option("-o", "--output", help="Draw into a PNG, SVG or PDF file.")]
Into = Annotated[
    Path | None, typer.Option("--into", help="Tree whose TreeNodesModel to write or renew; all else in it stays.")
]
Palette = Annotated[Path | None, typer.Option("-o", "--output", help="File to write. Default: stdout.")]


class _NoContext:
    """Context of a tree that never runs. maze: of the map whose rings and openings the tree may name; None: any."""

    def __init__(self, maze: Maze | None = None) -> None:
        if maze is not None:
            self.maze = maze

    def clock(self) -> float:
        """Time stands still, s."""
        return 0.0

    def failed(self, failure: Any) -> None:
        """Ignore the failure."""


def _load(source: str, modules: list[str] | None, maze: Maze | None = None) -> BehaviorTree:
    from mazeplan.behavior.ownleaves import registry_with
    from mazeplan.behavior.treefile import load_tree

    return load_tree(source, registry_with(modules or ()), _NoContext(maze))


@app.command("check")
def check(
    files: Trees, map_: CheckedMap = None, behavior_module: opt.BehaviorModule = None, json: opt.AsJson = False
) -> None:
    """Check trees, and name the file and line of each problem."""
    found = [_checked(source, map_, behavior_module) for source in files]
    if json:
        print_json(found)
    for tree in () if json else found:
        for line in (*tree["errors"], *(f"warning: {warning}" for warning in tree["warnings"])):
            say(f"mazeplan: {line}")
        if tree["ok"]:
            print(f"{tree['file']}: ok, {tree['nodes']} nodes")
    if not all(tree["ok"] for tree in found):
        raise SystemExit(2)


def _checked(source: str, map_: str | None, modules: list[str] | None) -> dict[str, Any]:
    """What there is to say of one tree."""
    from mazeplan.behavior.check import check_tree
    from mazeplan.maze.mapfile import load_map

    maze = None if map_ is None else load_map(map_)
    try:
        tree = _load(source, modules, maze)
    except TreeError as error:
        return {"file": source, "ok": False, "nodes": None, "error": str(error), "errors": [str(error)], "warnings": []}
    findings = check_tree(tree)
    errors, warnings = [str(e) for e in findings.errors], [str(w) for w in findings.warnings]
    error, nodes = (errors[0] if errors else None), len(list(tree.nodes()))
    return {"file": source, "ok": not errors, "nodes": nodes, "error": error, "errors": errors, "warnings": warnings}


@app.command("show")
def show(source: Tree = "navigate", output: Drawing = None, behavior_module: opt.BehaviorModule = None) -> None:
    """Show a tree as text, or draw it."""
    from mazeplan.behavior.drawing import save_tree_drawing, tree_text

    tree = _load(source, behavior_module)
    if output is None:
        print(tree_text(tree))
    else:
        save_tree_drawing(tree, output)
        say(f"wrote {output}")


@app.command("list")
def list_leaves(behavior_module: opt.BehaviorModule = None, json: opt.AsJson = False) -> None:
    """List leaves with their ports, control nodes and preconditions."""
    from mazeplan.behavior.conditions import DECISIONS
    from mazeplan.behavior.controls import CONTROLS
    from mazeplan.behavior.decorators import DECORATORS
    from mazeplan.behavior.ownleaves import registry_with

    registry = registry_with(behavior_module or ())
    leaves = dict(sorted(registry.usable(_report_unusable).items()))
    controls = [*CONTROLS, *DECORATORS, "SubTree"]
    if json:
        documents = {name: _document(leaf) for name, leaf in leaves.items()}
        print_json({"leaves": documents, "control_nodes": controls, "preconditions": list(DECISIONS)})
        return
    for name, leaf in leaves.items():
        owner = f" (package {registry.owners[name].source})" if name in registry.owners else ""
        print(f"{name}: {_purpose(leaf) or 'no docstring'}{owner}")
        for port_name, port in leaf.ports.items():
            print(f"    {port_name} ({_port_kind(port)}): {port.doc}{_allowed(port)}")
    print("control nodes: " + ", ".join(controls))
    print(f"preconditions of any node: {', '.join(DECISIONS)}, as _skipIf=\"legs &lt; 2 || word == 'fast'\"")


def _purpose(leaf: type[Leaf]) -> str:
    return (leaf.__doc__ or "").strip().partition("\n")[0]


def _port_kind(port: Port) -> str:
    """Type and default of a port."""
    from mazeplan.behavior.ports import REQUIRED

    kind = "output" if port.direction == "out" else port.type.__name__
    if port.default is REQUIRED:
        return f"{kind}, needed"
    return kind if port.default is None else f"{kind}, default {port.default}"


def _document(leaf: type[Leaf]) -> dict[str, Any]:
    """A leaf and its ports, for programs."""
    from mazeplan.behavior.ports import REQUIRED

    ports = {
        name: {
            "type": port.type.__name__, "direction": port.direction, "needed": port.default is REQUIRED,
            "default": None if port.default is REQUIRED else port.default, "what": port.doc,
            "allowed": None if port.choices is None or isinstance(port.choices, str) else [*port.choices],
            "allowed_of_map": port.choices if isinstance(port.choices, str) else None,
        }
        for name, port in leaf.ports.items()
    }  # fmt: skip
    return {"what": _purpose(leaf), "ports": ports}


def _report_unusable(problem: str) -> None:
    say(f"mazeplan: leaf ignored: {problem}")


def _allowed(port: Port) -> str:
    """The allowed values of a port, if they are limited."""
    if port.choices is None:
        return ""
    by_map = isinstance(port.choices, str)
    return "; allowed: " + (f"{port.choices} of the map" if by_map else ", ".join(map(str, port.choices)))


@app.command("palette")
def palette(output: Palette = None, into: Into = None, behavior_module: opt.BehaviorModule = None) -> None:
    """Write the leaves as a TreeNodesModel, for the palette of Groot2."""
    from mazeplan.behavior.ownleaves import registry_with
    from mazeplan.behavior.palette import renewed, write_palette

    leaves = registry_with(behavior_module or ()).usable(_report_unusable)
    if into is not None:
        _load(str(into), behavior_module)
        write_text(into, renewed(into.read_text(encoding="utf-8"), leaves))
        say(f"wrote the leaves into {into}")
        return
    text = write_palette(leaves)
    if output is None:
        print(text, end="")
    else:
        write_text(output, text)
        say(f"wrote {output}")
