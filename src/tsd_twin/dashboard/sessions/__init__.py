"""Per-kind parts of page sessions: telemetry, panels and the Student tab."""
