"""Messages between page and dashboard."""
