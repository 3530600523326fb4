"""The map editor (`mazeplan view --edit`): an optional part, which no other part of the page imports.

mapeditor.py   the map while it is edited: its text, problems, steps to undo, its file
scene.py       the maze, with openings and radial walls to drag
tab.py         the tab: scene, YAML with all errors, buttons
files.py       buttons for files and runs: save, new map, try a run
trial.py       a run on the map, in a process of its own
listing.py     the YAML as HTML
"""
