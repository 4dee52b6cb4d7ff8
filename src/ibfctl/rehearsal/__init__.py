"""Run a plan on an emulated controller and find what was removed; record of any run."""
