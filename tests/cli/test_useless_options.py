"""Options that would be ignored are refused, with what they need."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("navigate --port 8090", "--port: needs --view"),
        ("navigate --host 0.0.0.0", "--host: needs --view"),
        ("navigate --groot-host 0.0.0.0", "--groot-host: needs --groot"),
        ("navigate -o model", "-o: needs --learn"),
        ("evaluate -o model", "-o: needs --learn"),
        ("map show cme --from ring2", "--from: needs --route"),
        ("map show cme --to ring2", "--to: needs --route"),
        ("map show cme --start-angle 20", "--start-angle: needs --route"),
        ("map show cme --close no-such-opening", "--close: needs --route"),
        ("behavior palette -o new.xml --into navigate", "-o: got --into as well, expected one of the two"),
        ("calibrate tilt --readings r.csv --grid 5", "--grid: got --readings as well, expected one of the two"),
        ("calibrate camera --sheet a.pdf --boards b", "--boards: got --sheet as well, expected one of the two"),
        ("calibrate camera --sheet a.pdf --plate b", "--plate: got --sheet as well, expected one of the two"),
        ("calibrate camera --sheet a.pdf --circles", "--circles: got --sheet as well, expected one of the two"),
        ("calibrate camera --sheet a.pdf --dry-run", "--dry-run: got --sheet as well, expected one of the two"),
        ("calibrate camera --sheet a.pdf --json", "--json: got --sheet as well, expected one of the two"),
        ("calibrate camera --corners 9x6", "--corners: needs --boards"),
        ("calibrate camera --square-mm 20", "--square-mm: needs --boards"),
        ("effect list --markdown --json", "--markdown: got --json as well, expected one of the two"),
        ("view run.mcap --rig toy", "--rig: has no effect beside a log: leave it out"),
        ("rig check toy -o new.yaml", "-o: needs a real rig, whose latencies it keeps"),
    ],
)
def test_an_option_without_effect_is_refused(refused, monkeypatch, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused(*words.split())
    assert not list(tmp_path.iterdir())
