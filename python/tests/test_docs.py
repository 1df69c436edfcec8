"""The examples in the documentation."""

import doctest
import importlib

import pytest

MODULES = ["lightpath", "lightpath._rays", "lightpath._pictures", "lightpath.open3d"]


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    failed, run = doctest.testmod(importlib.import_module(name))
    assert run > 0 and failed == 0


def test_everything_public_is_described():
    package = importlib.import_module("lightpath")
    for name in package.__all__:
        thing = getattr(package, name)
        if isinstance(thing, str):
            continue
        assert thing.__doc__, name
        if isinstance(thing, type):
            # Methods, properties and class methods; not the constants of a class.
            own = [key for key, m in vars(thing).items() if not key.startswith("_") and hasattr(m, "__get__")]
            assert all(getattr(thing, key).__doc__ for key in own), (name, own)
