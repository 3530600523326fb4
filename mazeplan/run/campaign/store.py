"""A store: a folder with the runs of campaigns (Parquet, one row for each run). Each run is stored as it ends.

    runs/toy/campaign-4f1c09aa0b7e2d13.parquet                all runs until the end of the last command
    runs/toy/campaign-4f1c09aa0b7e2d13.run-00000042.parquet   a run that has ended since then

The letters identify the campaign (`identity`). Each file is first written under another name and then renamed, so a
file is never incomplete. At the end of a command the files of single runs are merged into one.
`pandas.read_parquet("runs/toy")` reads all of them.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mazeplan.core.errors import InputError
from mazeplan.core.file_format import format_problem
from mazeplan.core.records import NavigationResult
from mazeplan.core.resources import to_install
from mazeplan.rigs.registry import rig_label
from mazeplan.run.campaign.identity import LETTERS, difference, digest_of, identity, text_of
from mazeplan.run.campaign.lock import exclusive_lock
from mazeplan.run.campaign.one_run import Campaign
from mazeplan.run.campaign.parcel import Parcel, packed
from mazeplan.run.campaign.worker import Ran
from mazeplan.run.resolve import model_source

FORMAT, KEY = 1, b"mazeplan_format"  # format number, and its key in a file's metadata; a file without it has 1, too
TOGETHER = 1000  # files of single runs after which they are merged while the campaign goes on
SPREADS = ("p50", "p99", "max")
NAME = re.compile(rf"campaign-[0-9a-f]{{{LETTERS}}}(\.run-[0-9]+)?\.parquet")  # of a file in a store


def columns() -> Any:
    """The columns, as a schema of pyarrow; docs/campaigns.md explains them. Raises InputError without pyarrow."""
    try:
        import pyarrow as pa
    except ImportError:
        raise InputError(f"--store needs pyarrow: {to_install('campaign')}") from None
    text, number, words = pa.string(), pa.float64(), pa.list_(pa.string())
    return pa.schema(
        {
            "campaign": text, "index": pa.int32(), "seed": pa.int64(), "rig": text, "map": text, "model": text,
            "behavior": text, "start_ring": pa.int16(), "start_theta": number, "goal_ring": pa.int16(),
            "time_limit_s": number, "fault": text, "success": pa.bool_(), "reason": text, "time_s": number,
            "replans": pa.int32(), "failures": words, "recoveries": words, "rings": pa.list_(pa.int16()),
            "ring_s": pa.list_(number), "openings": words, **{f"planner_ms_{key}": number for key in SPREADS},
            **{f"tick_ms_{key}": number for key in SPREADS}, "wall_s": number, "cpu_s": number, "host": text,
            "ended": pa.timestamp("ms", tz="UTC"), "version": text, "settings": text, "setup": text, "result": text,
        }
    )  # fmt: skip


class Store:
    """The runs of one campaign in a folder.

    documents: {number of the run: its result as a JSON document} of the stored runs
    parcel: files of the campaign
    name: digest that identifies the campaign
    """

    def __init__(self, folder: Path, campaign: Campaign, parcel: Parcel, setup: Mapping[str, Any]) -> None:
        self._columns = columns()
        self.folder, self.parcel = folder, parcel
        self._setup, self._text, self.name = setup, text_of(setup), digest_of(setup)
        self._rows: list[Any] = []  # tables of the stored runs, without the columns that are the same for all runs
        self._single: list[Path] = []
        model = model_source(campaign.model, campaign.rig)
        self._same = {
            "campaign": self.name, "rig": rig_label(campaign.rig), "map": Path(campaign.map).stem,
            "model": "nominal" if model is None else Path(model).name, "behavior": Path(campaign.behavior).stem,
            "start_ring": setup["start_ring"], "goal_ring": setup["goal_ring"],
            "time_limit_s": campaign.time_limit, "fault": (setup["fault"] or {}).get("name"),
            "version": setup["program"]["mazeplan"], "settings": json.dumps(setup["settings"]), "setup": self._text,
        }  # fmt: skip
        self.documents: dict[int, dict[str, Any]] = {}
        self._read()

    @property
    def results(self) -> dict[int, NavigationResult]:
        """{number of the run: its result} of the stored runs."""
        return {index: NavigationResult.from_json(document) for index, document in self.documents.items()}

    @property
    def whole(self) -> Path:
        """Path of the file of all runs."""
        return self.folder / f"campaign-{self.name}.parquet"

    def _read(self) -> None:
        import pyarrow as pa

        for path in [self.whole, *sorted(self.folder.glob(f"campaign-{self.name}.run-*.parquet"))]:
            if not path.exists():
                continue
            table = _table(path, [name for name in self._columns.names if name not in self._same], self._columns)
            fresh = [number not in self.documents for number in table["index"].to_pylist()]
            table = table.filter(pa.array(fresh, pa.bool_()))  # a command killed while it merges leaves runs twice
            for number, text in zip(table["index"].to_pylist(), table["result"].to_pylist(), strict=True):
                self.documents[number] = json.loads(text)
            self._rows.append(table)
            self._single += [path] if path != self.whole else []

    def keep(self, index: int, ran: Ran, document: dict[str, Any] | None = None) -> None:
        """Store a run at once. document: replaces the document of its result, if it has to hold more."""
        import pyarrow as pa

        document = ran.result.to_json() if document is None else document
        row = {**row_of(index, ran), "result": json.dumps(document)}
        own = pa.schema([field for field in self._columns if field.name not in self._same])
        table = pa.Table.from_pylist([row], schema=own)
        path = self.folder / f"campaign-{self.name}.run-{index:08d}.parquet"
        self._write(table, path)
        self._rows.append(table)
        self._single.append(path)
        self.documents[index] = document
        if len(self._single) >= TOGETHER:
            self.put_together()

    def put_together(self) -> None:
        """Merge all files of the campaign into one, in the order of the runs."""
        import pyarrow as pa

        if not self._single:
            return
        table = pa.concat_tables(self._rows).sort_by("index")
        self._write(table, self.whole)
        for path in self._single:
            path.unlink(missing_ok=True)
        self._rows, self._single = [table], []

    def _write(self, table: Any, path: Path) -> None:
        """Write rows with all columns, some at a time: for all rows the columns that never differ would fill the
        memory."""
        import pyarrow.parquet as pq

        beside = path.with_name(f".{path.name}.{os.getpid()}")  # readers of the folder skip names with a leading dot
        metadata = {KEY: str(FORMAT), b"mazeplan_version": version("mazeplan")}
        schema = self._columns.with_metadata(metadata)
        try:
            with beside.open("wb") as file:
                with pq.ParquetWriter(file, schema, compression="zstd", write_statistics=False) as writer:
                    for start in range(0, len(table), TOGETHER):
                        writer.write_table(self._with_all(table.slice(start, TOGETHER)).cast(schema))
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)

    def _with_all(self, table: Any) -> Any:
        """The rows with all columns, also those that are the same for all runs."""
        import pyarrow as pa

        columns = [
            pa.array([self._same[field.name]] * len(table), field.type)
            if field.name in self._same
            else table[field.name]
            for field in self._columns
        ]
        return pa.table(columns, schema=self._columns)

    def others(self, known: Iterable[str] = ()) -> list[str]:
        """A line for each other campaign in the folder: its name, and in what it differs. Leaves out the names in
        `known`."""
        found: dict[str, Path] = {}
        for path in sorted(self.folder.glob("campaign-*.parquet")):
            name = path.name.split(".")[0].removeprefix("campaign-")
            if name not in {self.name, *known}:
                found.setdefault(name, path)
        return [f"{name} (other {difference(self._setup, _setup_in(path))})" for name, path in found.items()]


def row_of(index: int, ran: Ran) -> dict[str, Any]:
    """The columns of a row that differ from run to run."""
    result = ran.result
    return {
        "index": index,
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
        "wall_s": ran.wall_s,
        "cpu_s": ran.cpu_s,
        "host": ran.host,
        "ended": datetime.now(UTC),
    }


def _table(path: Path, only: list[str] | None = None, expected: Any = None) -> Any:
    """Read a Parquet file. Raises InputError for a file that cannot be read, or has other columns than expected.

    only: names of the columns to read; None: all
    expected: schema that the file must have; None: any
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            metadata = file.schema_arrow.metadata or {}
            if refused := _refused(metadata):
                raise InputError(refused, file=path, key="mazeplan_format")
            if expected is not None and file.schema_arrow.remove_metadata() != expected:
                raise InputError("got other columns than this program writes, expected another folder", file=path)
            return file.read(only).replace_schema_metadata()
    except (pa.ArrowException, OSError) as problem:
        raise _damaged(path, problem) from None


def _refused(metadata: Mapping[bytes, bytes]) -> str | None:
    """Why a file with this metadata cannot be read; None if it can."""
    given, written_by = (metadata.get(key, b"").decode(errors="replace") for key in (KEY, b"mazeplan_version"))
    return format_problem(int(given) if given.isdecimal() else given or FORMAT, FORMAT, written_by)


def _setup_in(path: Path) -> Mapping[str, Any]:
    with suppress(InputError, LookupError, ValueError, AttributeError):
        return dict(json.loads(_table(path, ["setup"])["setup"][0].as_py()))
    return {}


def _check_folder(folder: Path) -> None:
    """Raises InputError for a folder that is no store, and for a damaged file of any campaign.

    A store may hold other files, but no other Parquet files: a reader of the whole folder would take them for runs."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    there = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    ours = [path for path in there if NAME.fullmatch(path.name)]
    for path in there:
        if path not in ours and (not ours or path.suffix == ".parquet"):
            expected = "expected a new or empty folder, or one with runs of `evaluate` only"
            raise InputError(f"--store: {folder} is no store of runs: it holds {path.name}; {expected}")
    for path in ours:
        try:
            pq.read_metadata(path)
        except FileNotFoundError:  # another command has just merged its files
            continue
        except (pa.ArrowException, OSError) as problem:
            raise _damaged(path, problem) from None


def _damaged(path: Path, problem: Exception) -> InputError:
    """The error for a file of a campaign that cannot be read."""
    why = " ".join(str(problem).split())
    return InputError(
        f"cannot be read as runs of a campaign: {why}; without this file its runs are done again", file=path
    )


@contextmanager
def open_store(folder: Path, campaign: Campaign) -> Iterator[Store]:
    """The store of a campaign in a folder, as a context manager, for one process at a time. It makes the folder.
    Afterwards the runs are in one file, whatever happens.

    Raises InputError if the folder cannot be used, or if another process does this campaign there."""
    with open_stores(folder, campaign, [None]) as (store,):
        yield store


@contextmanager
def open_stores(
    folder: Path, campaign: Campaign, faults: Sequence[Mapping[str, Any] | None]
) -> Iterator[tuple[Store, ...]]:
    """As `open_store`, with one store for each entry of `faults`: runs with another fault are another campaign.

    faults: documents with the `name` of the fault; None: no fault"""
    columns()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputError(f"--store: got {folder}: {problem.strerror}; expected a folder that can be made") from None
    _check_folder(folder)
    parcel = packed(campaign)
    setups = [{**identity(campaign, parcel), "fault": fault} for fault in faults]
    with ExitStack() as stack:
        stores = []
        for setup in setups:
            lock = folder / f".campaign-{digest_of(setup)}.lock"
            stack.enter_context(exclusive_lock(lock, "--store", "this campaign"))
            stores.append(Store(folder, campaign, parcel, setup))
            stack.callback(stores[-1].put_together)
        yield tuple(stores)
