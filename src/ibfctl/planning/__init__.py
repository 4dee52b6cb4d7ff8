"""The planner that joins surface, path, dwell and schedule; the plan file."""
