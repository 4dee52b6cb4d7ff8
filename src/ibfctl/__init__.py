"""Plan, schedule, run and prove deterministic finishing on Galil motion controllers."""

__version__ = "0.1.0"
