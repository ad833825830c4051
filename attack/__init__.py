"""Attacks on live processes, each with the guarantee that it tests."""
