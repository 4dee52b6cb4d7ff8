"""Runs: a program streamed to a controller, watched, and proven."""
