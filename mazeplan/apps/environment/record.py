"""The expert's episodes as a data set: a Parquet file, or a data set of Minari.

A Parquet file has one row for each step, with these columns: `episode`, `seed` (of the reset), `step`, `observation`,
`action`, `reward`, `next_observation`, `terminated`, `truncated`, and `ring`, `time_s`, `success` from the info.
Pictures are stored as bytes, row by row. The metadata of the file has a JSON document under the key `mazeplan`:
environment, options, expert, and shape and names of the observations. The same seed and actions give the same
observations and rewards again.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from mazeplan.apps.environment import ID
from mazeplan.apps.environment.expert import Expert
from mazeplan.apps.environment.senses import NAMES
from mazeplan.apps.environment.single import CircularMazeEnv
from mazeplan.core.errors import InputError, SettingsError
from mazeplan.core.file_format import format_problem
from mazeplan.core.progress import Advance, no_advance
from mazeplan.core.records import Array
from mazeplan.core.resources import to_install

KEY, FORMAT = b"mazeplan", 1  # a header without `format` also has format 1


@dataclass(frozen=True)
class Episode:
    """One episode of T steps.

    seed: seed of its reset.
    observations (T+1, ...), actions (T, 2), rewards (T,): as the environment has them.
    rings (T,): ring of the ball after each step.
    times (T,): rig time after each step, s.
    terminated, truncated: how the episode ended.
    success: whether the ball arrived."""

    seed: int
    observations: np.ndarray
    actions: np.ndarray
    rewards: Array
    rings: np.ndarray
    times: Array
    terminated: bool
    truncated: bool
    success: bool


@dataclass(frozen=True)
class Recording:
    """What to record.

    episodes: number of episodes.
    seed: seed of the first episode; the others have seed + 1, seed + 2, ...
    options: options of the environment.
    model, behavior: model and tree of the expert."""

    episodes: int
    seed: int
    options: dict[str, Any]
    model: str | None = None
    behavior: str = "navigate"

    def header(self, env: CircularMazeEnv) -> dict[str, Any]:
        """The JSON document for the metadata of the file."""
        return {
            "format": FORMAT, "environment": ID, "options": self.options,
            "expert": {"model": self.model, "behavior": self.behavior},
            "version": version("mazeplan"), "observation_shape": list(env.observation_space.shape or ()),
            "observation_names": list(NAMES) if env.episodes.task.observation == "state" else [],
            "tilt_limit_rad": env.episodes.maze.tilt_limit,
        }  # fmt: skip


def played(env: gymnasium.Env, expert: Expert, seed: int) -> Episode:
    """Play one episode of the expert. The environment may have any wrappers."""
    observation, _ = env.reset(seed=seed)
    expert.begin()
    observations, actions, rewards, rings, times = [observation], [], [], [], []
    while True:
        action = expert.act()
        observation, reward, terminated, truncated, info = env.step(action)
        actions.append(action)
        rewards.append(float(reward))
        observations.append(observation)
        rings.append(info["ring"])
        times.append(info["time_s"])
        if terminated or truncated:
            break
    return Episode(
        seed, np.array(observations), np.array(actions), np.array(rewards), np.array(rings), np.array(times),
        bool(terminated), bool(truncated), bool(info["success"]),
    )  # fmt: skip


def record(recording: Recording, path: Path, progress: Advance = no_advance) -> dict[str, Any]:
    """Play episodes and write them to a Parquet file. Returns what `mazeplan record --json` prints.

    Raises InputError if the file cannot be written or pyarrow is missing."""
    pq = _pyarrow()
    partly = path.with_name(path.name + ".part")  # so that a file with the final name is always complete
    env, one, expert = _made(recording)
    finished: list[Episode] = []
    writer = None
    try:
        for number, episode in enumerate(_all(recording, env, expert, finished, progress)):
            table = _table(number, episode, recording.header(one))
            writer = pq.ParquetWriter(partly, table.schema) if writer is None else writer
            writer.write_table(table)
        if writer is not None:
            writer.close()
        partly.replace(path)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None
    finally:
        with suppress(OSError):
            partly.unlink(missing_ok=True)
        env.close()
    return _summary(finished, str(path))


def record_minari(recording: Recording, dataset: str, progress: Advance = no_advance) -> dict[str, Any]:
    """Play episodes and make a Minari data set on this computer. Returns what `mazeplan record --json` prints.

    Raises InputError if Minari is missing or does not accept the name."""
    try:
        import minari  # pyright: ignore[reportMissingImports]  (not among the extras)
        from minari.data_collector import EpisodeBuffer  # pyright: ignore[reportMissingImports]
        from minari.dataset.minari_dataset import parse_dataset_id  # pyright: ignore[reportMissingImports]

        parse_dataset_id(dataset)  # raises ValueError for a bad name, before any episode is played
    except ImportError:
        raise InputError("--minari needs Minari: pip install 'minari[arrow]'; or -o FILE.parquet") from None
    except ValueError as problem:
        raise InputError(str(problem).splitlines()[0], key=f"--minari {dataset}") from None
    if dataset in minari.list_local_datasets():
        raise InputError("there is one of that name on this computer", key=f"--minari {dataset}")
    env, _, expert = _made(recording)
    finished: list[Episode] = []
    buffers = []
    try:
        for number, episode in enumerate(_all(recording, env, expert, finished, progress)):
            last = np.arange(len(episode.actions)) == len(episode.actions) - 1
            buffers.append(
                EpisodeBuffer(
                    number, episode.seed, None, list(episode.observations), list(episode.actions),
                    list(episode.rewards), list(last & episode.terminated), list(last & episode.truncated),
                )
            )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Minari warns that no author is named
            minari.create_dataset_from_buffers(
                dataset, buffers, env=env, algorithm_name="mazeplan navigate", requirements=["mazeplan[gym]"],
                description=json.dumps({"options": recording.options, "seed": recording.seed}),
                data_format="arrow", jpeg_encoding=False,
            )  # fmt: skip
    except (ImportError, ValueError) as problem:
        raise InputError(str(problem).splitlines()[0], key=f"--minari {dataset}") from None
    finally:
        env.close()
    return _summary(finished, dataset)


def _made(recording: Recording) -> tuple[gymnasium.Env, CircularMazeEnv, Expert]:
    env = gymnasium.make(ID, **recording.options)
    one = env.unwrapped
    if not isinstance(one, CircularMazeEnv):
        raise TypeError(f"got {type(one).__name__}, expected CircularMazeEnv")
    return env, one, Expert(one, recording.model, recording.behavior)


def _all(
    recording: Recording, env: gymnasium.Env, expert: Expert, finished: list[Episode], progress: Advance
) -> Iterator[Episode]:
    """Play the episodes, and yield each one when it ends. finished: gets the parts that a summary needs."""
    for number in range(recording.episodes):
        episode = played(env, expert, recording.seed + number)
        finished.append(_light(episode))
        yield episode
        progress(number + 1, recording.episodes)


def _light(episode: Episode) -> Episode:
    """The episode without its large arrays."""
    nothing = np.zeros(0)
    return Episode(
        episode.seed, nothing, nothing, episode.rewards, nothing, episode.times, episode.terminated, episode.truncated,
        episode.success,
    )  # fmt: skip


def _summary(finished: list[Episode], where: str) -> dict[str, Any]:
    times = [float(episode.times[-1]) for episode in finished if episode.success]
    return {
        "episodes": len(finished),
        "success": len(times),
        "steps": int(sum(len(episode.rewards) for episode in finished)),
        "mean_return": float(np.mean([episode.rewards.sum() for episode in finished])) if finished else None,
        "mean_time_s": float(np.mean(times)) if times else None,
        "written": where,
    }


# -- Parquet -------------------------------------------------------------------------------------------------------


def _pyarrow() -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise InputError(f"Parquet files need pyarrow: {to_install('gym')}") from None
    return pyarrow.parquet


def _table(number: int, episode: Episode, header: dict[str, Any]) -> Any:
    import pyarrow as pa

    steps = len(episode.actions)
    last = np.arange(steps) == steps - 1
    pictures = episode.observations.dtype == np.uint8

    def observed(values: np.ndarray) -> Any:
        if pictures:
            return pa.array([picture.tobytes() for picture in values], pa.binary())
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])

    table = pa.table(
        {
            "episode": np.full(steps, number), "seed": np.full(steps, episode.seed), "step": np.arange(steps),
            "observation": observed(episode.observations[:-1]),
            "action": pa.FixedSizeListArray.from_arrays(pa.array(episode.actions.ravel()), 2),
            "reward": episode.rewards, "next_observation": observed(episode.observations[1:]),
            "terminated": last & episode.terminated, "truncated": last & episode.truncated,
            "ring": episode.rings, "time_s": episode.times, "success": last & episode.success,
        }
    )  # fmt: skip
    return table.replace_schema_metadata({KEY: json.dumps(header).encode()})


def load_episodes(path: str | Path) -> tuple[dict[str, Any], list[Episode]]:
    """The document and the episodes of a file that `record` wrote. Raises SettingsError for any other file."""
    pq = _pyarrow()
    if not Path(path).exists():
        raise SettingsError("no such file", file=path)
    try:
        table = pq.read_table(path)
        header = json.loads((table.schema.metadata or {})[KEY])
    except (OSError, KeyError, ValueError) as problem:
        what = problem.strerror if isinstance(problem, OSError) and problem.strerror else "is no recording of mazeplan"
        raise SettingsError(what, file=path) from None
    if refused := format_problem(header.get("format", FORMAT), FORMAT, header.get("version")):
        raise SettingsError(refused, file=path, key="format")
    columns = {name: table.column(name) for name in table.column_names}
    numbers = columns["episode"].to_numpy()
    shape, read = tuple(header["observation_shape"]), _reader(tuple(header["observation_shape"]))
    found = []
    for number in np.unique(numbers):
        part = np.flatnonzero(numbers == number)
        begin, steps = int(part[0]), len(part)

        def of(name: str, begin: int = begin, steps: int = steps) -> Any:
            """A column of this episode."""
            return columns[name].slice(begin, steps)

        whole = np.concatenate([read(of("observation")), read(of("next_observation"))[-1:]]).reshape(-1, *shape)
        found.append(
            Episode(
                int(of("seed")[0].as_py()), whole, np.array(of("action").to_pylist(), dtype=np.float32),
                of("reward").to_numpy(), of("ring").to_numpy(), of("time_s").to_numpy(),
                bool(of("terminated")[-1].as_py()), bool(of("truncated")[-1].as_py()), bool(of("success")[-1].as_py()),
            )
        )  # fmt: skip
    return header, found


def _reader(shape: tuple[int, ...]) -> Callable[[Any], np.ndarray]:
    """A function that converts a column to observations, one in each row."""
    if len(shape) == 3:
        return lambda column: np.array([np.frombuffer(one, np.uint8) for one in column.to_pylist()])
    return lambda column: np.array(column.to_pylist(), dtype=np.float32)
