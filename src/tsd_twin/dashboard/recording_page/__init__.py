"""Page of a part of a recording: one HTML file with scene and timeline, or a picture of it."""

from tsd_twin.dashboard.recording_page.build import to_html, to_picture

__all__ = ["to_html", "to_picture"]
