"""Knee assessment: probabilities of movement disorders, and the most informative movement.

Not a medical device; trained on simulated patients.
"""

from typing import Literal

# Summaries of a database, and measures of what a movement would tell: as options name them.
Summary = Literal["people", "distributions", "centroids"]
Measure = Literal["expected", "thesis", "inherent"]
NOTICE = "Not a medical device. Trained on simulated patients, never on people."
MEASURED_NOTICE = "Not a medical device. Tried on simulated patients only, never on people."
