"""Whether an HTML page stands alone: nothing in it, nor in its pictures, is loaded from elsewhere or runs."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

REFERENCES = {"src", "href", "action", "data", "poster", "srcset", "style", "onload", "onclick", "onerror"}


class Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.references, self.policy = [], [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in REFERENCES]
        if dict(attrs).get("http-equiv") == "Content-Security-Policy":
            self.policy = dict(attrs)["content"]


def read(path):
    text = path.read_text()
    reader = Reader()
    reader.feed(text)
    return text, reader


def svgs(text):
    return [base64.b64decode(data) for data in re.findall(r'src="data:image/svg\+xml;base64,([^"]*)"', text)]


def alone(path):
    """Check that a page loads nothing; what is in it without its pictures."""
    text, reader = read(path)
    assert set(reader.tags).isdisjoint({"script", "link", "iframe", "object", "embed", "form", "base"})
    assert all(value.startswith(("data:image/", "#part")) for value in reader.references)
    assert "default-src 'none'" in reader.policy
    assert "script-src" not in reader.policy
    plain = re.sub(r'src="data:[^"]*"', "", text)
    assert "://" not in plain
    assert "@import" not in plain
    assert "url(" not in plain
    for picture in svgs(text):
        ElementTree.fromstring(picture)
        assert not re.search(rb'(href|src)="(?!#|data:image/png;)', picture)
        assert not re.search(rb"url\((?!#)", picture)
        assert b"<script" not in picture
    assert path.stat().st_size < 5_000_000
    return plain
