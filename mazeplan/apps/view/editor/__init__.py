"""The map editor (`mazeplan view --edit`): an optional part, which no other part of the page imports.

mapeditor.py   a map that is edited: its text, problems, steps to undo, its file
scene.py       the maze, and blocks to drag in its openings
tab.py         the tab: scene, YAML with all errors, buttons
listing.py     the YAML as HTML
"""
