"""What the server of `warm` has loaded before it forks: libraries, and compiled code of a run and of its learning."""

import contextlib
import tempfile
from pathlib import Path

import cv2  # noqa: F401  what follows is imported by many commands, each where it needs it
import matplotlib.figure
import matplotlib.image  # noqa: F401
import pandas  # noqa: F401
import scipy.signal
import scipy.stats  # noqa: F401
import sklearn.ensemble  # noqa: F401
import torch  # noqa: F401

import mazeplan.apps.cli.app
import mazeplan.apps.report.models
import mazeplan.diagnosis.rig.verdict  # noqa: F401
from mazeplan.run.execution import navigate

with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(None):
    navigate(4, 5, rig="toy", log=Path(folder, "run.mcap"))
