"""Knee: what is known of a movement disorder, and which movement would tell most.

Not a medical device; trained on simulated patients.
"""

NOTICE = "Not a medical device. Trained on simulated patients, never on people."
MEASURED_NOTICE = "Not a medical device. Tried on simulated patients only, never on people."
