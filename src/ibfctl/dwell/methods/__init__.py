"""Methods of the literature for dwell times, side by side: each takes a problem and answers with a `Solution`."""
