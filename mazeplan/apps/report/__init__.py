"""Reports: a run, evaluations, models, a diagnosis, each as one HTML file that stands alone, and its pictures as files.

    log or document --inputs--> what it is --run, evaluation, models, diagnosis--> Section --page--> HTML, PNG, SVG

What a picture shows is computed by functions without Matplotlib, which is imported when something is drawn.
"""
