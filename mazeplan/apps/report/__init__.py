"""Reports of a run, of evaluations, of models, or of a diagnosis. A report is one HTML file that needs no other file.
Its pictures can also be written as separate files.

    log or document --inputs--> Input --run, evaluation, models, diagnosis--> PageSection --page--> HTML, PNG, SVG

Functions without Matplotlib compute what a picture shows. Matplotlib is imported only when a picture is drawn.
"""
