"""Attacks on live processes, each with the promise that it tries to break."""
