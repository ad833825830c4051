"""Compare the sentences in the page's tests with the robot's."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec

from tests.messages.reasons import fixed_reasons
from tsd_twin.messages.sentences import full_sentence, sentence

VECTORS = Path(__file__).parent / "reasons.json"


def vectors() -> str:
    """Codes with their sentences, one per line; `python -m` of this module writes the file."""
    rows = [
        {
            "reason": msgspec.to_builtins(reason),
            "part": sentence(reason),
            "whole": full_sentence(reason),
        }
        for reason in fixed_reasons()
    ]
    lines = ",\n".join(json.dumps(row, ensure_ascii=False) for row in rows)
    return f"[\n{lines}\n]\n"


def test_vectors_are_up_to_date() -> None:
    """web/tests/text/reasons.test.ts compares the page's formatter with them."""
    assert VECTORS.read_text(encoding="utf-8") == vectors()


if __name__ == "__main__":
    VECTORS.write_text(vectors(), encoding="utf-8")
