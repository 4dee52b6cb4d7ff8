"""Emulated motion controllers that real clients can talk to over TCP."""
