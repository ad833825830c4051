"""Dashboard server: HTTP, authentication, sessions, teleoperation, navigation and telemetry."""
