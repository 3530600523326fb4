"""The page in the browser, on which a person looks at a run and operates it. Only this package imports viser.

    messages of a run -> story -> Moment -> scene, page -> viser -> browsers
                                                                 orders <-

story.py                a run at one time, made from its messages; for live page and replay
page.py                 what live page and replay share: the loop that draws; facts and tree of a run
scene.py                maze, ball, trail, plan and openings in 3D
film.py                 a film of a run, of the same moments
link.py                 the live page; its process, and the line to the run, which never waits for it
replay.py               the page of a recorded run
server.py               viser behind a check of Host and Origin
parts.html              heads, facts, tree and the bar with the emergency stop, as HTML
"""
