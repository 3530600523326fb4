"""Reports of a run, of evaluations, of models, or of a diagnosis. A report is one HTML file that needs no other file.

    log or document --inputs--> Input --runs, models, diagnosis--> PageSection --page--> HTML

Functions without Matplotlib compute what a picture shows. Matplotlib is imported only when a picture is drawn.
"""
