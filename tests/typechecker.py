"""The tests' run-time type checker: beartype with PEP 484's rule that an int will do where a float is asked for.

It takes a third of the time of a run. So ``make test`` checks the first calls of every function in every test and a
sample of those that follow; ``make test-all``, and a test that is called by its name, check every call.
"""

import dataclasses
import functools
import inspect
from collections import defaultdict

import jaxtyping
from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))

FIRST = 32
"""Calls of a function that are checked in each test."""
LATER = 16
"""Of those that follow, one in so many is checked."""

_test = 0
_counts = defaultdict(lambda: [0, 0])  # By code, because nested functions are made anew in every call of the outer one.
_check_calls = jaxtyping.jaxtyped


def next_test():
    """Counts anew, so that what a test checks does not hang on those before it."""
    global _test
    _test += 1


def _check_some_calls(fn, *, typechecker):
    decorate = functools.partial(_check_some_calls, typechecker=typechecker)
    if inspect.isclass(fn):
        if dataclasses.is_dataclass(fn) and "__init__" in vars(fn) and not hasattr(fn.__init__, "__wrapped__"):
            fn.__init__ = decorate(fn.__init__)
        return fn
    if isinstance(fn, classmethod | staticmethod):
        return type(fn)(decorate(fn.__func__))
    if isinstance(fn, property):
        return property(*(each and decorate(each) for each in (fn.fget, fn.fset, fn.fdel)))
    count, checked = _counts[fn.__code__], None

    @functools.wraps(fn)
    def call(*args, **kwargs):
        nonlocal checked
        if count[0] != _test:
            count[:] = _test, 0
        count[1] += 1
        if count[1] > FIRST and count[1] % LATER:
            return fn(*args, **kwargs)
        if checked is None:  # Built for functions that are called only: to build it takes a millisecond.
            checked = _check_calls(fn, typechecker=typechecker)
        return checked(*args, **kwargs)

    return call


def check_some_calls():
    """Let the import hook decorate with the sample."""
    jaxtyping.jaxtyped = lambda *, typechecker: functools.partial(_check_some_calls, typechecker=typechecker)
