"""All colours, dashes, markers and hatches of pictures and pages, by meaning. Other files only add white and
the grey of a button.

The colours are those of Okabe and Ito (Color Universal Design, 2008). Some are darkened so that lines on white can be
read: contrast 3 or more, except for the unimportant fills `skipped` and `idle`. Things that are shown together also
differ in lightness. So they stay distinct in grey print, and for eyes that see only two of the three basic colours. In
a thin line, lightness alone is not enough. Therefore a line also has dashes, a point has a marker, an area has a hatch:
use both.
"""

from __future__ import annotations

COLOURS: dict[str, str] = {
    # planned or commanded, and measured: theta, tilt
    "planned": "#D55E00",
    "real": "#004B79",
    "commanded": "#D55E00",
    "measured": "#004B79",
    # the second of two balls
    "second": "#CC79A7",
    # an opening, a candidate, an error before and after
    "good": "#008561",
    "bad": "#7A2000",
    "unsure": "#C28800",
    "neutral": "#747474",
    # rings from the outermost, each lighter than the one before
    "ring1": "#000000",
    "ring2": "#004B82",
    "ring3": "#B04A00",
    "ring4": "#009068",
    "ring5": "#CC79A7",
    # a sixth series beside those five, of models and evaluations
    "sixth": "#3D008A",
    # nodes of a tree
    "running": "#005F99",
    "success": "#2AA37C",
    "failure": "#7A2000",
    "skipped": "#B9B9B9",
    "idle": "#E6E6E6",
}

# colours of text; each has a contrast of 4.5 or more on white (WCAG 2.1)
INKS: dict[str, str] = {
    "ink": "#1C1F24",
    "quiet": "#565D67",
    "good": "#00785A",
    "success": "#00785A",
    "bad": "#7A2000",
    "failure": "#7A2000",
    "unsure": "#8A6100",
    "planned": "#B04A00",
    "running": "#005F99",
    "skipped": "#565D67",
    "neutral": "#565D67",
}

# light fills behind text in "ink" and "quiet"
TINTS: dict[str, str] = {
    "paper": "#FFFFFF",
    "band": "#F1F3F6",
    "bad": "#FBE9E2",
    "chosen": "#E3EEF7",
    "Control": "#CFE2F3",
    "Decorator": "#FCE5CD",
    "SubTree": "#FFF2A8",
    "Action": "#FFFFFF",
    "Condition": "#FFFFFF",
    "failure": "#F6C9C0",
    "running": "#CBE3F5",
    "success": "#C9ECDD",
}

# the button that stops a machine
STOP: dict[str, str] = {"face": "#B00000", "pressed": "#700000"}

# lines that only guide the eye
FAINT: dict[str, str] = {"grid": "#DDDDDD", "rule": "#C9CED6", "hatch": "#C4C4C4"}

# a maze: plan view
MAZE: dict[str, str] = {
    "wall": "#B9BEC5",
    "edge": "#5B626B",
    "floor": "#FFFFFF",
    "closed": "#C0392B",
    "plug": "#F6D5D1",
    "ball": "#7D858F",
    "shine": "#E8EBEE",
}

SPEEDS = "viridis"  # colour map of Matplotlib for the speed along a trail

# lengths of dash and gap in widths of the line; () is a solid line
DASHES: dict[str, tuple[float, ...]] = {
    "planned": (4.0, 1.5),
    "commanded": (4.0, 1.5),
    "bad": (4.0, 1.5),
    "unsure": (1.0, 1.2),
    "neutral": (1.0, 1.2),
    "second": (2.0, 1.0),
    "ring2": (5.0, 1.5),
    "ring3": (1.0, 1.2),
    "ring4": (5.0, 1.2, 1.0, 1.2),
    "ring5": (8.0, 1.5),
    "sixth": (4.0, 1.0, 1.0, 1.0, 1.0, 1.0),
}


def dashes(name: str) -> tuple[float, ...]:
    """Lengths of dash and gap of the line `name`, in widths of the line; () for a solid line."""
    return DASHES.get(name, ())


def rgb(name: str) -> tuple[int, int, int]:
    """The colour `name` as red, green, blue, each 0 to 255."""
    colour = COLOURS[name]
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
