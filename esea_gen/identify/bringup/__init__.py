"""Judging a drive that is brought up: what ``esea-host commission`` and ``friction`` share."""
