"""Scene and panels of the dashboard, drawn with viser."""
