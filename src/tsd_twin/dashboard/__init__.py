"""Dashboard: web server, three-dimensional scene and page for remote driving."""
