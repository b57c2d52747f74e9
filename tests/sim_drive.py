"""The elbow's drive as a board in this process, as tests of its wire and of its states use it."""

from __future__ import annotations

ANGLES = {"count_motor": 700.0, "count_load": 900.0, "count_gear": 5.0}


def zeroed(board, **angles: float):
    board.measure(**ANGLES | angles)
    board.ticks(20)
    board.zero()
    board.ticks(230)
    assert board.state_now == "READY"
    return board


def active(board, tau_Nm: float = 0.1, ticks: int = 1):
    board.arm()
    board.ticks(1)
    board.want(mode=1.0, tau_desired_Nm=tau_Nm)
    board.ticks(ticks)
    assert board.state_now == "ACTIVE"


def texts(board) -> list[str]:
    return [m.text for m in board.pending() if m.get_type() == "STATUSTEXT"]
