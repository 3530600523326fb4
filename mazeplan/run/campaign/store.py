"""A store: a folder with the runs of campaigns. Each run is stored as it ends.

    runs/toy/campaign-4f1c09aa0b7e2d13.jsonl    one line for the campaign, then one for each run
    runs/toy/runs.parquet                       a table of all runs in the folder (with pyarrow)

The letters identify the campaign (`identity`): everything that determines its results. The number of runs and the
places of files are left out, so the same command with more runs goes on with the same campaign. The table is made anew
at the end of each command.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mazeplan.core import resources
from mazeplan.core.errors import InputError
from mazeplan.core.file_kinds import format_problem
from mazeplan.core.records import NavigationResult
from mazeplan.core.user_modules import user_module
from mazeplan.core.whole_file import lock, whole_file
from mazeplan.learning.modelfile import RigModel
from mazeplan.rigs.files import read_rig_file
from mazeplan.rigs.registry import rig_file, rig_label
from mazeplan.run.campaign.one_run import Campaign, Noticed, Ran
from mazeplan.run.resolve import model_source
from mazeplan.run.specification import file_sha256, log_header

LETTERS = 16  # length of a digest: these letters of a SHA-256 are enough for the few campaigns of a folder
PACKAGES = ("mazeplan", "numpy", "scipy", "numba", "mujoco")
NOT_FOR_RESULTS = {"cli", "view", "report", "_share", "__pycache__"}  # folders of the package
KINDS = {".py", ".yaml", ".xml", ".npz", ".png"}


def identity(campaign: Campaign) -> dict[str, Any]:
    """Everything that determines the results of a campaign, as a document of names, numbers and texts.

    Files that the user's code opens itself, and modules that the user's modules import, are left out. Raises InputError
    if a part of the campaign cannot be used."""
    ready = campaign.resolve(job=campaign.job_of(0))
    header = log_header(ready.setup, ready.job, ready.rig.rate_hz)
    facts, path = header["replay"], rig_file(str(campaign.rig))
    kind, settings = (str(campaign.rig), {}) if path is None else read_rig_file(path)
    files = {**facts["modules"], **{name: facts[name] for name in ("effects", "policy") if name in facts}}
    return {
        "program": dict(program()),
        "rig": {
            "class": kind, "settings": {key: value for key, value in settings.items() if key != "model"},
            "file": None if kind is None else file_sha256(user_module(kind.partition(":")[0], "rig").__file__ or ""),
        },
        **{name: header[name] for name in ("map", "start_ring", "goal_ring", "seed", "time_limit_s")},
        "model": facts["model_sha256"],
        "behavior": facts["behavior_sha256"],
        "settings": facts["settings"],
        "files": {name: file["sha256"] for name, file in files.items()},
        "fault": None if campaign.fault is None else campaign.fault.to_json(),
    }  # fmt: skip


def digest_of(document: Mapping[str, Any]) -> str:
    """A short digest of a document."""
    text = json.dumps(document, sort_keys=True, default=str, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:LETTERS]


@cache
def program() -> Mapping[str, str]:
    """{package: version}, `python`, and `sources`: a digest of all files of the package that affect results."""
    digest = hashlib.sha256()
    for name, path in sorted(_files()):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode())
        digest.update(content)
    versions = {name: version(name) for name in PACKAGES}
    return {**versions, "python": ".".join(platform.python_version_tuple()[:2]), "sources": digest.hexdigest()[:16]}


def _files() -> Iterator[tuple[str, Path]]:
    """Names and paths of the files that affect results. Names are the same in a checkout and in an installed wheel."""
    for path in resources.PACKAGE.rglob("*"):
        inside = path.relative_to(resources.PACKAGE)
        if path.suffix in KINDS and not NOT_FOR_RESULTS & set(inside.parts):
            yield inside.as_posix(), path
    for kind in ("maps", "behaviors"):
        for path in resources.share(kind).iterdir():
            if path.suffix in KINDS:
                yield f"{kind}/{path.name}", path


def program_mismatch(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """In words, in what another machine's program differs from ours; empty if in nothing."""
    return ", ".join(
        f"{name} {theirs.get(name, 'none')} instead of {ours[name]}" for name in ours if theirs.get(name) != ours[name]
    )


if TYPE_CHECKING:
    import pandas as pd

FORMAT = 1
SPREADS = ("p50", "p99", "max")
TABLE = "runs.parquet"
FAULT_KEYS = tuple(field.name for field in fields(Noticed))


class Store:
    """The runs of one campaign in a folder.

    runs: {number of the run: the run} of the stored ones
    name: digest that identifies the campaign
    """

    def __init__(self, folder: Path, campaign: Campaign, setup: Mapping[str, Any]) -> None:
        self.folder = folder
        self.name = digest_of(setup)
        self.path = folder / f"campaign-{self.name}.jsonl"
        given = campaign.model
        model = given.kind if isinstance(given, RigModel) else model_source(given, str(campaign.rig))
        head = {
            "format": FORMAT, "version": version("mazeplan"), "campaign": self.name,
            "rig": rig_label(str(campaign.rig)), "map": campaign.maze.name,
            "model": "nominal" if model is None else str(model), "behavior": Path(campaign.tree).stem,
            "start_ring": setup["start_ring"], "goal_ring": setup["goal_ring"],
            "time_limit_s": campaign.time_limit, "fault": (setup["fault"] or {}).get("name"), "setup": setup,
        }  # fmt: skip
        self.runs: dict[int, Ran] = {}
        if self.path.exists():
            _, rows = read_runs(self.path)
            self.runs = {
                row["index"]: Ran(result_of(row["result"]), Noticed.of_document(row["result"])) for row in rows
            }
            content = self.path.read_bytes()
            if not content.endswith(b"\n"):  # a last line without its end
                with self.path.open("r+b") as file:
                    file.truncate(content.rfind(b"\n") + 1)
        else:
            self._append(head)

    def keep(self, index: int, ran: Ran) -> None:
        """Store a run at once."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        times = {"wall_s": ran.wall_s, "cpu_s": ran.cpu_s, "host": ran.host, "ended": now}
        self._append({"index": index, **times, "result": ran.document()})
        self.runs[index] = ran

    def _append(self, row: Mapping[str, Any]) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row, default=str) + "\n")
            file.flush()
            os.fsync(file.fileno())


def read_runs(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The first line of a campaign's file, and the lines of its runs. A last line without its end is left out: the
    command was killed as it wrote. Raises InputError."""
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
        rows = [json.loads(line) for line in lines]
        head, runs = rows[0], rows[1:]
        if refused := format_problem(head["format"], FORMAT, head.get("version")):
            raise InputError(refused, file=path, key="format")
        return head, [row for row in runs if isinstance(row["index"], int) and isinstance(row["result"], dict)]
    except (ValueError, LookupError, TypeError, OSError) as problem:
        why = f"cannot be read as runs of a campaign: {' '.join(str(problem).split())}"
        raise InputError(f"{why}; without this file its runs are done again", file=path) from None


def runs_table(folder: Path) -> pd.DataFrame:
    """A table of all runs in a folder, one row for each; docs/campaigns.md explains the columns. Raises InputError."""
    import pandas as pd  # slow to import

    rows = [row_of(head, run) for head, runs in map(read_runs, campaign_files(folder)) for run in runs]
    table = pd.DataFrame(rows)
    return table if table.empty else table.astype({"ended": "datetime64[ms, UTC]"}).sort_values(["campaign", "index"])


def row_of(head: Mapping[str, Any], run: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a run. head: the first line of its file; run: its line."""
    result = result_of(run["result"])
    same = {key: value for key, value in head.items() if key not in ("format", "setup")}
    return {
        **same,
        "index": run["index"],
        "seed": result.seed,
        "start_theta": None if result.start is None else result.start.theta,
        "success": result.success,
        "reason": result.reason,
        "time_s": result.time_s,
        "replans": result.replans,
        "failures": [str(failure.kind) for failure in result.failures],
        "recoveries": [failure.recovery for failure in result.failures],
        "rings": [passage.ring for passage in result.rings],
        "ring_s": [passage.time_s for passage in result.rings],
        "openings": [passage.opening for passage in result.rings],
        **{f"planner_ms_{key}": result.planner_ms.get(key) for key in SPREADS},
        **{f"tick_ms_{key}": result.tick_ms.get(key) for key in SPREADS},
        **{key: run[key] for key in ("wall_s", "cpu_s", "host", "ended")},
        "settings": head["setup"]["settings"],
        "setup": json.dumps(head["setup"]),
        "result": json.dumps(run["result"]),
    }


def result_of(document: Mapping[str, Any]) -> NavigationResult:
    """The result in a document, which may have keys about faults."""
    return NavigationResult.from_json({key: value for key, value in document.items() if key not in FAULT_KEYS})


def campaign_files(folder: Path) -> list[Path]:
    """The files of the campaigns in a folder."""
    return sorted(folder.glob("campaign-*.jsonl"))


def _write_table(folder: Path) -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return
    with whole_file(folder / TABLE) as beside:
        runs_table(folder).to_parquet(beside, index=False)


@contextmanager
def open_stores(folder: Path, campaigns: Sequence[Campaign]) -> Iterator[tuple[Store, ...]]:
    """The store of each campaign in a folder, as a context manager, for one process at a time. It makes the folder, and
    afterwards the table, whatever happens.

    Raises InputError if the folder cannot be used, or if another process does one of the campaigns there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"--store: got {folder}: {problem.strerror}; expected a folder that can be made") from None
    if any(folder.iterdir()) and not campaign_files(folder):
        expected = "expected a new or empty folder, or one with runs of `evaluate`"
        raise InputError(f"--store: {folder} is no store of runs: it holds other files; {expected}")
    with ExitStack() as stack:
        stores = []
        stack.callback(_write_table, folder)
        for campaign in campaigns:
            setup = identity(campaign)
            try:
                file = stack.enter_context((folder / f".campaign-{digest_of(setup)}.lock").open("a"))
            except OSError as problem:
                raise InputError(f"--store: {folder} cannot be written to: {problem.strerror}") from None
            if not lock(file):
                raise InputError(f"--store: this campaign is under way in {folder} already")
            stores.append(Store(folder, campaign, setup))
        yield tuple(stores)
