"""The page in the browser: a run to look at and to operate, live and afterwards. Only this room imports viser.

    messages of a run -> story -> Moment -> scene, panel, plots -> viser -> browsers
                                                                 orders <-

moment.py, story.py     a run at one time, made of its messages; live page and replay share them
run_statistics.py       rows, errors of plans and chances of openings in a moment
page.py                 a page: a server behind the check at its door, and tabs that are drawn 30 times a second
scene.py, meshes.py     maze, ball, trail, plan and openings in 3D
camera.py               where the camera stands
plots.py, panel.py      curves; facts and behaviour tree
film.py                 a film of a run, of the same moments
lookback.py             the time of a live run, to look back in
livetab.py, link.py     the tab of a live run; the page's process and its line to the run, which never waits for it
serving.py              pages without a live run
server.py, door.py      viser behind a check of Host, Origin and token; clientfix.py mends viser's client
replay/                 recorded runs (optional)
editor/                 a map to edit (optional)

To add a tab write a class with `build(page)`, called once while the page is made, inside its own
`page.tabs.add_tab(...)`, and `draw(now)`, called by the page's one thread that draws; hand it to `Page(tabs=...)`.
"""
