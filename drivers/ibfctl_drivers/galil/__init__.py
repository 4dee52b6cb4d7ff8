"""Galil DMC-40x0, 41x3 and 42x0: link, words, gate and controller."""
