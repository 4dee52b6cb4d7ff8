"""Whole jobs on files, as the command line and the service do them: plan, rehearse, record."""
