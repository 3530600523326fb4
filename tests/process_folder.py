"""A model folder with a process, and what is done to it: put in, edited, refused."""

from __future__ import annotations

import hashlib
import io
import re

import numpy as np
import pytest
from gaussian_processes import plain

from mazeplan.core.errors import ModelError
from mazeplan.learning.gaussian_process import GaussianProcess
from mazeplan.learning.gp_file import rounded
from mazeplan.learning.modelfile import RigModel, load_model
from mazeplan.physics.ball_model import BallModel
from mazeplan.physics.effects.ball import rolling_inertia
from mazeplan.physics.rig.stage import StageModel


def process(n=50, seed=0):
    rng = np.random.default_rng(seed)
    x = rounded(rng.standard_normal((n, 9)))
    hyper = plain(np.exp(0.5 * rng.standard_normal(9)), 1.7320508, 0.31415926)
    return GaussianProcess.condition(hyper, x, np.zeros((n, 0)), np.sin(x[:, 0]) + x[:, 3])


BALLS = {1: BallModel((rolling_inertia(0.58),)), 2: BallModel((rolling_inertia(0.6),))}
MODEL = RigModel(StageModel(), BALLS, kind="sp", processes={1: process(), 2: process(80, 1)})


def assert_refused(folder, key, *said, line_of=None):
    """Loading fails with one line that names file, line and key."""
    with pytest.raises(ModelError) as error:
        load_model(folder)
    text, path = str(error.value), folder / "model.yaml"
    found = re.fullmatch(rf"{re.escape(str(path))}:(\d+): {re.escape(key)}: .+", text)
    assert found, text
    line = path.read_text().splitlines()[int(found[1]) - 1]
    assert (line_of or key.split(".")[-1]) in line, (line, text)
    for part in said:
        assert part in text
    return text


def put(folder, content, ring=1):
    """Other arrays for a ring, and model.yaml told so: what someone does who wants to get past the checksum."""
    path, model = folder / f"ring{ring}.npz", folder / "model.yaml"
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    path.write_bytes(content)
    assert before in model.read_text()
    model.write_text(model.read_text().replace(before, hashlib.sha256(content).hexdigest()))


def arrays(folder, ring=1):
    with np.load(folder / f"ring{ring}.npz", allow_pickle=False) as held:
        return {name: held[name] for name in held.files}


def saved(**held):
    stream = io.BytesIO()
    np.savez_compressed(stream, **held)
    return stream.getvalue()


def edit(folder, old, new):
    path = folder / "model.yaml"
    text, changed = path.read_text(), re.sub(old, new, path.read_text(), count=1)
    assert changed != text
    path.write_text(changed)
