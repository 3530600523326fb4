"""The page in the browser: a run to look at and to operate, live and afterwards. viser is imported in this room alone.

    messages of a run -> story -> Moment -> scene, panel, plots -> viser -> browsers
                                                                 orders <-

moment.py, story.py   what is to be shown of a run at one time, from its messages; pure, live and replay share them
page.py               a page: a server behind the check at its door, and tabs that are drawn 25 times a second
scene.py              maze, ball, trail, plan and openings in 3D:  Scene(server, maze).show(moment)
plots.py              tilt, theta and planner times:               Plots(server).show(moment)
panel.py              behaviour tree and last failure:             TreePanel(server).show(moment)
livetab.py            the tab of a run that goes on, with its buttons
replaying.py          recorded runs: their moments, one time for all of them, and what to jump to
editor.py             a map that is edited: its text, problems, what can be undone, its file
door.py               who may come in: Host, Origin and token of each request
process.py, link.py   the page as a process of its own, and its line to the run: the run never waits for it

To add a tab write a class with `build(page)`, called once while the page is made, inside its own
`page.tabs.add_tab(...)`, and `draw(now)`, called by the page's one thread that draws; hand it to `Page(tabs=...)`.
"""
