"""The page in the browser, on which a person looks at a run and operates it. Only this package imports viser.

    messages of a run -> story -> Moment -> scene, panel -> viser -> browsers
                                                                 orders <-

story.py                a run at one time, made from its messages; for live page and replay
page.py                 a page: a server, and its tab, which is drawn 30 times a second
scene.py                maze, ball, trail, plan and openings in 3D
panel.py                facts and behaviour tree
film.py                 a film of a run, of the same moments
link.py                 the tab of a live run; the page's process and its line to the run, which never waits for it
replay.py               the page of a recorded run
server.py               viser behind a check of Host and Origin; the bar with the emergency stop
"""
