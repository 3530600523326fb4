"""`data import-cme`: measurements of the published rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from mazeplan.apps.cli import options as opt
from mazeplan.apps.cli.output import print_json, say

app = typer.Typer(help="Import measured data.", no_args_is_help=True, rich_markup_mode=None)

FIGURES = ("step", "published", "recovered", "segments", "noise", "noise_variance")
ModelsFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of the model files, CircularMaze/Models in PyRoboCOP.")
]
TablesFolder = Annotated[Path, opt.output_folder("Folder for ring1.csv, ring2.csv ...")]


@app.callback()
def _group() -> None:
    """Import measured data."""


@app.command("import-cme")
def import_cme(
    folder: ModelsFolder, output: TablesFolder, force: opt.Force = False, as_json: opt.AsJson = False
) -> None:
    """Recover the measurements from the published model files of the rig, one table per ring.

    The files are not part of mazeplan. Their licence applies to the tables, too."""
    from mazeplan.apps.cli.progress import ProgressBar
    from mazeplan.core.progress import piece
    from mazeplan.learning.published_rig import find_models, import_ring, read_model, write_ring

    models = {ring: read_model(folder, ring, ending) for ring, ending in find_models(folder).items()}
    paths = {ring: output / f"ring{ring}.csv" for ring in models}
    found = {}
    with ProgressBar("importing") as bar:
        for i, (ring, model) in enumerate(models.items()):
            bar.show(f"ring {ring}")
            found[ring] = import_ring(model, advance=piece(bar.advance, i, 1, len(models)))
            write_ring(found[ring], paths[ring])
    document: dict[str, dict[str, Any]] = {}
    for ring, imported in found.items():
        figures = {name: getattr(imported, name) for name in FIGURES}
        document[f"ring{ring}"] = {"file": str(paths[ring]), "source": imported.file.name, **figures}
    if as_json:
        print_json(document)
    else:
        for ring, row in document.items():
            print(
                f"{ring}: {row['published']} rows published (1 sample in {row['step']}), {row['recovered']} recovered, "
                f"{row['segments']} segments; noise {row['noise']:.4g} rad/s^2"
            )
    say(f"wrote {', '.join(path.name for path in paths.values())} to {output}")
