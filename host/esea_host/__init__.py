"""The host tool: telemetry, recordings, and experiments with people.

Rooms, from the top floor down: ``cli``; the windows; the three studies; the study engine; the
simulated board; the connection to a board; recordings; metrics and statistics.
"""
