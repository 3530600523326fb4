"""The layouts in docs/layouts name only what a log has."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

from mazeplan.core.logs.run_log import SCHEMAS
from mazeplan.core.logs.viewer_topics import VIEWER_SCHEMAS

LAYOUTS = Path(__file__).resolve().parents[2] / "docs" / "layouts"


def panels_of(node):
    return [node] if isinstance(node, str) else panels_of(node["first"]) + panels_of(node["second"])


def test_foxglove_shows_topics_and_fields_that_there_are():
    layout = json.loads((LAYOUTS / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    assert sorted(panels_of(layout["layout"])) == sorted(panels)
    fields = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(fields) > 10
    for field in fields:
        topic, _, name = field.partition(".")
        assert name in SCHEMAS[topic]["properties"], field
    assert set(panels["3D!maze"]["topics"]) <= set(VIEWER_SCHEMAS)
    assert panels["RosOut!log"]["topicToRender"] in VIEWER_SCHEMAS


def test_plotjuggler_shows_fields_that_there_are():
    curves = [curve.attrib["name"] for curve in ET.parse(LAYOUTS / "plotjuggler.xml").getroot().iter("curve")]
    assert len(curves) > 10
    for curve in curves:
        assert curve.removeprefix("/tick/") in SCHEMAS["/tick"]["properties"], curve
