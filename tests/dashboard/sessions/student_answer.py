"""Reply of the Student tab without a server."""

from __future__ import annotations

from tsd_twin.dashboard.sessions.student import solve
from tsd_twin.dashboard.wire.from_page import StudentRequest
from tsd_twin.dashboard.wire.student import StudentReply


def answer(request: StudentRequest) -> StudentReply:
    return solve(request)[0]
