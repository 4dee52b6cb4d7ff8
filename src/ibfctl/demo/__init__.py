"""The demo job, and its way from map to as-run residual."""
