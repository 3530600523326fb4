"""The expert's episodes: played, written, read, and played again."""

import json

import gymnasium
import numpy as np
import pytest
from commands import call

from mazeplan.apps.environment.record import Recording, load_episodes
from mazeplan.apps.environment.record import record as write
from mazeplan.core.errors import SettingsError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two episodes of the expert on the toy, from ring 4: the summary and the file."""
    path = tmp_path_factory.mktemp("record") / "two.parquet"
    options = {"rig": "toy", "reward": "dense", "start_ring": 4, "discount": 0.98}
    return write(Recording(2, 11, options), path), path


def test_the_planner_arrives_and_its_episodes_are_kept(recorded):
    done, path = recorded
    header, episodes = load_episodes(path)
    assert (done["episodes"], done["success"], done["written"]) == (2, 2, str(path))
    assert done["steps"] == sum(len(episode.actions) for episode in episodes)
    assert [episode.seed for episode in episodes] == [11, 12]
    assert done["mean_time_s"] == pytest.approx(np.mean([episode.times[-1] for episode in episodes]))
    assert header["options"]["start_ring"] == 4
    assert len(header["observation_names"]) == header["observation_shape"][0]
    for episode in episodes:
        assert episode.success
        assert episode.terminated
        assert not episode.truncated
        assert len(episode.observations) == len(episode.actions) + 1
        assert episode.rings[0] == 4
        assert episode.rings[-1] == 5
        assert np.abs(episode.actions).max() <= 1.0
        assert episode.actions.std() > 0.1


def test_the_same_seed_and_actions_give_the_same_again(recorded):
    header, episodes = load_episodes(recorded[1])
    env = gymnasium.make(header["environment"], **header["options"])
    for episode in episodes:
        observation, _ = env.reset(seed=episode.seed)
        for step, action in enumerate(episode.actions):
            np.testing.assert_array_equal(observation, episode.observations[step])
            observation, reward, terminated, _, info = env.step(action)
            assert reward == episode.rewards[step]
            assert terminated == (step == len(episode.actions) - 1)
        np.testing.assert_array_equal(observation, episode.observations[-1])
        assert info["success"]


def test_rows_of_the_file_are_steps(recorded):
    import pyarrow.parquet as pq

    table = pq.read_table(recorded[1])
    assert table.num_rows == recorded[0]["steps"]
    assert sum(table.column("success").to_pylist()) == 2
    assert sum(table.column("terminated").to_pylist()) == 2
    first = table.slice(0, 2).to_pylist()
    assert first[0]["next_observation"] == first[1]["observation"]
    assert (first[1]["step"], first[1]["episode"], first[1]["seed"]) == (1, 0, 11)


def test_from_the_command_line(monkeypatch, capsys, tmp_path):
    path = tmp_path / "one.parquet"
    code, out, _ = call(
        monkeypatch, capsys, "record", "--episodes", 1, "--rig", "ideal", "--from", "ring4", "-o", path, "--json"
    )
    assert code == 0
    assert json.loads(out)["success"] == 1
    assert len(load_episodes(path)[1]) == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["one.parquet"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "expected one"),
        (["-o", "a.parquet", "--minari", "a-v0"], "expected one"),
        (["-o", "{here}/file/a.parquet"], "is a file"),
        (["-o", "a.csv"], "-o: got 'a.csv', expected a file that ends in .parquet"),
        (["-o", "a.parquet", "--from", "ring9"], "mazeplan: --from: got 'ring9'"),
        (["-o", "a.parquet", "--from", "ring5", "--to", "ring5"], "mazeplan: --from: got ring 5, which is the goal"),
        (["-o", "a.parquet", "--minari", "a/b-v0"], "mazeplan: -o: got --minari as well, expected one of the two"),
        ([], "mazeplan: got neither -o FILE.parquet nor --minari NAME, expected one of the two"),
        (["-o", "a.parquet", "--reward", "great"], "--reward: got 'great', expected one of sparse, dense"),
        (["-o", "a.parquet", "--model", "no-such-model"], "no-such-model"),
    ],
)
def test_what_cannot_be_recorded_is_one_line(monkeypatch, capsys, tmp_path, arguments, words):
    (tmp_path / "file").write_text("")
    monkeypatch.chdir(tmp_path)
    code, out, err = call(monkeypatch, capsys, "record", *(text.format(here=tmp_path) for text in arguments))
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert not [*tmp_path.glob("*.parquet*"), *tmp_path.glob("*.csv*")]


def test_who_interrupts_is_told_what_is_kept(monkeypatch, capsys, tmp_path):
    def interrupted(env, expert, seed):
        raise KeyboardInterrupt

    monkeypatch.setattr("mazeplan.apps.environment.record.played", interrupted)
    monkeypatch.chdir(tmp_path)
    code, out, err = call(monkeypatch, capsys, "record", "--rig", "ideal", "-o", "a.parquet")
    assert (code, out) == (130, "")
    assert "no episode is kept: a data set is written only when it is complete\n" in err
    assert not [*tmp_path.iterdir()]


def test_a_file_that_is_none_of_ours_is_refused(tmp_path):
    (tmp_path / "a.parquet").write_text("no")
    for name, words in (("a.parquet", "is no recording of mazeplan"), ("b.parquet", "no such file")):
        with pytest.raises(SettingsError, match=f"{name}: {words}"):
            load_episodes(tmp_path / name)
