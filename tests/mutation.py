"""Mistakes planted in memory: a function of the package is replaced wherever it is used, no file is touched."""

import inspect
import sys


def mutate(monkeypatch, function, old, new):
    """Replace `function` in every module that uses it by a copy in whose source `old` reads `new`."""
    source = inspect.getsource(function)
    assert source.count(old) == 1, f"{function.__name__} has no single {old!r} any more: adapt this mutant"
    namespace = dict(function.__globals__)
    exec(compile(source.replace(old, new), f"mutant of {function.__name__}", "exec"), namespace)
    for name, module in list(sys.modules.items()):
        if name.startswith("rotordx.") and getattr(module, function.__name__, None) is function:
            monkeypatch.setattr(module, function.__name__, namespace[function.__name__])
