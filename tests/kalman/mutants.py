"""Copies of functions with one mistake, in place of the originals; no file is touched."""

import inspect
import sys


def mutate(monkeypatch, function, old, new):
    """Replace `function` wherever rotordx uses it by a copy in whose source `old` reads `new`."""
    source = inspect.getsource(function)
    assert source.count(old) == 1, f"{function.__name__} has no single {old!r} any more: adapt this mutant"
    namespace = function.__globals__
    local = dict(namespace)
    exec(compile(source.replace(old, new), f"mutant of {function.__name__}", "exec"), local)
    mutant = local[function.__name__]
    rebound = type(function)(mutant.__code__, namespace, function.__name__, mutant.__defaults__, mutant.__closure__)
    rebound.__kwdefaults__ = mutant.__kwdefaults__
    for name, module in list(sys.modules.items()):
        if name.startswith("rotordx") and getattr(module, function.__name__, None) is function:
            monkeypatch.setattr(module, function.__name__, rebound)
