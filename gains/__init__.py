"""Gains, bounds and certificates of the diagnosers, one module each; designs from given flights, never simulates."""
