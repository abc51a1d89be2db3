"""Flies co-simulated systems of FMUs, and scores, stores and reports what happened."""
