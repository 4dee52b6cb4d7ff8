"""The same examples on every machine and every day; how many is said where a test is dear."""

from hypothesis import settings

settings.register_profile("deterministic", deadline=None, derandomize=True)
settings.load_profile("deterministic")
