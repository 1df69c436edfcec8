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
        if isinstance(thing, type):
            own = [m for key, m in vars(thing).items() if not key.startswith("_") and callable(m)]
            assert thing.__doc__ and all(method.__doc__ for method in own), name
