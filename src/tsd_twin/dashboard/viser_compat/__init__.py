"""Adaptations of viser 1.1.1: private API, patches, and a server with access control."""
