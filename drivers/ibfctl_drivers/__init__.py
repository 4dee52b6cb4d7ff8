"""Drivers that put the product's port on the motion controllers of this world."""
