"""`data import-cme`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mazeplan.cli.output import print_json, say
from mazeplan.errors import InputError

if TYPE_CHECKING:
    from mazeplan.data.cme_import import ImportedRing

app = typer.Typer(help="Measured data from elsewhere.", no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def _group() -> None:
    """Measured data from elsewhere."""


@app.command("import-cme")
def import_cme(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of the model files, CircularMaze/Models in PyRoboCOP.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Folder for ring1.csv, ring2.csv ...")],
    force: Annotated[bool, typer.Option("--force", help="Overwrite the tables.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")] = False,
) -> None:
    """The published model files of the rig, back to the measurements they were trained on, a table per ring.

    The files are not part of mazeplan; the tables are under their licence, not under that of mazeplan.
    """
    from mazeplan.cli.progress import Working
    from mazeplan.data.cme_import import find_models, import_ring, read_model, write_ring
    from mazeplan.progress import piece

    models = {ring: read_model(folder, ring, ending) for ring, ending in find_models(folder).items()}
    paths = {ring: output / f"ring{ring}.csv" for ring in models}
    for path in paths.values():
        if path.exists() and not force:
            raise InputError("exists already; give --force to overwrite it", file=path)
    found = {}
    with Working("importing") as shown:
        for i, (ring, model) in enumerate(models.items()):
            shown.tell(f"ring {ring}")
            found[ring] = import_ring(model, advance=piece(shown.advance, i, 1, len(models)))
            write_ring(found[ring], paths[ring])
    told = {f"ring{ring}": _document(imported, paths[ring]) for ring, imported in found.items()}
    if as_json:
        print_json(told)
    else:
        print("\n".join(_line(imported) for imported in found.values()))
    say(f"wrote {', '.join(path.name for path in paths.values())} to {output}")


def _document(imported: ImportedRing, path: Path) -> dict[str, Any]:
    return {
        "file": str(path),
        "source": imported.file.name,
        "step": imported.step,
        "published": imported.published,
        "recovered": imported.recovered,
        "segments": imported.segments,
        "noise": imported.noise,
        "noise_variance": imported.noise_variance,
        "checks": dict(imported.checks),
    }


def _line(imported: ImportedRing) -> str:
    """A ring for people: rows, segments, noise, and what should be 0."""
    checks = ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in imported.checks.items())
    return (
        f"ring {imported.ring}: {imported.published} rows published (1 sample in {imported.step}), "
        f"{imported.recovered} recovered, {imported.segments} segments; noise {imported.noise:.4g} rad/s^2 "
        f"(variance {imported.noise_variance:.6g}); should be 0: {checks}"
    )
