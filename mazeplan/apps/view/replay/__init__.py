"""Recorded runs (`mazeplan view LOG [OTHER]`): an optional part, which no other part of the page imports.

recorded.py    a log as moments, and one time for all runs, that plays, stops and jumps
tab.py         the tab: mazes beside each other, curves, controls of time, failures, trees
"""
