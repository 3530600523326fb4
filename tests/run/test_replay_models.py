"""The model of a run that is replayed: by name, by folder, or out of the log itself."""

from __future__ import annotations

import pytest
from replayed import MAZE, planar

from mazeplan.core.errors import InputError, LogError
from mazeplan.core.logs.run_log import RunLogWriter
from mazeplan.core.logs.run_log_reader import read_attachment, read_messages
from mazeplan.learning.modelfile import ATTACHED, load_model, packed_model, save_model, unpacked_model
from mazeplan.run.execution import navigate
from mazeplan.run.replay import replay
from mazeplan.run.resolve import resolve_model


@pytest.mark.slow
def test_a_model_is_told_by_its_content(tmp_path):
    folder, path = tmp_path / "model", tmp_path / "run.mcap"
    save_model(resolve_model("ideal", None, MAZE), folder)
    navigate(4, 5, rig="ideal", model=folder, log=path)
    folder.rename(tmp_path / "moved")
    assert replay(path).identical  # the log holds it
    with pytest.raises(InputError, match="no such model"):
        replay(path, model=folder)
    assert replay(path, model=tmp_path / "moved").identical
    text = (tmp_path / "moved" / "model.yaml").read_text()
    (tmp_path / "moved" / "model.yaml").write_text(text.replace("rate_hz: 30", "rate_hz: 31"))
    with pytest.raises(LogError, match=r"the model .*moved is not that of the run, by its SHA-256; --model PATH"):
        replay(path, model=tmp_path / "moved")
    planar(path)  # a model that no file holds
    with pytest.raises(LogError, match=r"the model nominal physics \(the run had one that no file holds\) is not that"):
        replay(path)
    own = tmp_path / "own.yaml"
    own.write_text("camera_noise_mm: 0.1\n")
    navigate(4, 5, rig=str(own), log=path)
    assert read_attachment(path, ATTACHED) is None
    assert replay(path).identical  # nominal physics
    navigate(4, 5, rig="ideal", log=path)
    assert read_attachment(path, ATTACHED) is None  # a packaged one
    navigate(4, 5, rig="ideal", model=load_model("toy"), log=path)  # as an object
    assert replay(path).identical


def attach(path, data):
    """The log with another file in the place of its model."""
    header, messages, _ = read_messages(path)
    with RunLogWriter(path, header) as log:
        log.attach(ATTACHED, "application/zip", data)
        for topic, document in messages[1:]:
            log.write(topic, document.get("t", 0.0), document)


def test_a_packed_model_is_the_same_and_the_same_bytes_each_time():
    model = load_model("toy")
    data = packed_model(model)
    assert data == packed_model(load_model("toy"))
    assert packed_model(unpacked_model(data)) == data
