"""Attacks on live processes, each with the guarantee it tests."""
