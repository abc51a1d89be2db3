"""One folder per diagnoser; each is discovered by its `step.py`."""
