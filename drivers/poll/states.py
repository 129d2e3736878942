"""The states of a servo line, and the events that lead from one to the next.

`ServoDriver` follows `TRANSITIONS` and nothing else. At most one request is on the line: `plan.py`
chooses it, `answers.py` decides how long to wait for its answers.
"""

from __future__ import annotations

from enum import Enum


class LineState(Enum):
    """The states of a line, each with the driver's action."""

    CLOSED = "no port is open; opens it when that is due"
    IDLE = "no exchange is open; sends what is due"
    BLOCKED = "a servo may be busy, or the line full; sends nothing for a while"
    ASKED = "a request is out, nothing has come; chooses the next request, then listens"
    ANSWERING = "bytes have come, answers are missing; listens"
    ANSWERED = "the answers are here; sends what is due before the exchange is closed"


class LineEvent(Enum):
    """The events of a line."""

    OPENED = "the port is open"
    LOST = "the port broke, was silent for too long, or is no longer wanted"
    SENT = "a request went out"
    PAUSED = "a write went out, or the line did not take a request or a write whole"
    RELEASED = "the pause is over"
    BYTES = "bytes came"
    COMPLETE = "the last missing answers came"
    OVER = "the exchange is closed: answered, or nothing came for too long"


_S, _E = LineState, LineEvent

TRANSITIONS = {
    (_S.CLOSED, _E.OPENED): _S.IDLE,
    (_S.IDLE, _E.SENT): _S.ASKED,
    (_S.IDLE, _E.PAUSED): _S.BLOCKED,
    (_S.IDLE, _E.BYTES): _S.IDLE,  # not requested
    (_S.BLOCKED, _E.RELEASED): _S.IDLE,
    (_S.BLOCKED, _E.BYTES): _S.BLOCKED,  # the answer to a write, which is ignored
    (_S.BLOCKED, _E.OVER): _S.BLOCKED,  # the line did not take the next request
    (_S.ASKED, _E.BYTES): _S.ANSWERING,
    (_S.ASKED, _E.OVER): _S.IDLE,
    (_S.ANSWERING, _E.BYTES): _S.ANSWERING,
    (_S.ANSWERING, _E.COMPLETE): _S.ANSWERED,
    (_S.ANSWERING, _E.OVER): _S.IDLE,
    (_S.ANSWERED, _E.SENT): _S.ASKED,  # the next request closes the exchange
    (_S.ANSWERED, _E.PAUSED): _S.BLOCKED,
    (_S.ANSWERED, _E.OVER): _S.IDLE,
    **{(state, _E.LOST): _S.CLOSED for state in _S},
}
