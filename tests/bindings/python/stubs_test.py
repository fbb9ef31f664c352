import ast
import inspect
import os

import pytest

import volalign


def test_everything_is_documented():
    for name in volalign.__all__:
        thing = getattr(volalign, name)
        if inspect.isclass(thing) or callable(thing):
            assert thing.__doc__ and len(thing.__doc__.splitlines()) >= 1, name


@pytest.mark.stubs
def test_the_stubs_have_everything():
    folder = os.path.dirname(volalign.__file__)
    assert os.path.exists(os.path.join(folder, "py.typed"))
    with open(os.path.join(folder, "__init__.pyi"), encoding="utf-8") as file:
        body = ast.parse(file.read()).body
    named = {node.name for node in body if isinstance(node, ast.ClassDef)} | {node.target.id for node in body if isinstance(node, ast.AnnAssign)}
    assert named | {name.name for node in body if isinstance(node, ast.ImportFrom) for name in node.names} >= set(volalign.__all__)
