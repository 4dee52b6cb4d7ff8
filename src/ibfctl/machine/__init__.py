"""The machine as the product sees it: its description, its programs, and the port that a driver implements."""
