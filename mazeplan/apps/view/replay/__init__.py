"""Recorded runs (`mazeplan view LOG [OTHER]`): an optional part, which no other part of the page imports.

recorded.py         a log as moments, and the time of the replay, which plays, stops and jumps
logged_moments.py   the moments of a log, read when they are needed
tab.py              the tab: mazes beside each other, curves, controls of time, failures, trees
"""
