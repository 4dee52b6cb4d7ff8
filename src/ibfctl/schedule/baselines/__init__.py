"""Other ways to move along a path, for comparison alone: nothing here is ever sent to a machine."""
