"""Mistakes planted in memory: a function of the package is replaced wherever it is used, no file is touched."""

import inspect
import sys
from importlib import import_module

from rotordx.fmus import diagnoser_ids


def mutate(monkeypatch, function, old, new):
    """Replace `function` in every module that uses it by a copy in whose source `old` reads `new`."""
    for diagnoser in diagnoser_ids():  # imported later, while it is replaced, a step would keep the mutant for good
        import_module(f"rotordx.fmus.diagnosers.{diagnoser}.step")
    source = inspect.getsource(function)
    assert source.count(old) == 1, f"{function.__name__} has no single {old!r} any more: adapt this mutant"
    namespace = dict(function.__globals__)
    exec(compile(source.replace(old, new), f"mutant of {function.__name__}", "exec"), namespace)
    for name, module in list(sys.modules.items()):
        if name.startswith("rotordx.") and getattr(module, function.__name__, None) is function:
            monkeypatch.setattr(module, function.__name__, namespace[function.__name__])
