import ast
import inspect
import re

import volalign


def stub():
    with open(volalign.__file__ + "i", encoding="utf-8") as file:
        return ast.parse(file.read())


def public(names):
    return {name for name in names if not name.startswith("_")}


def signature(function):
    """Names of the arguments as pybind11's docstring has them."""
    text = function.__doc__.split(" -> ")[0]
    text = text[text.index("(") + 1 :]
    return [name for name in re.findall(r"(?:^|, )\*{0,2}(\w+)(?=:|,|\)|$)(?![^\[{(<']*[\]})>'])", text) if name != "self"]


def arguments(node):
    names = [argument.arg for argument in node.args.args + node.args.kwonlyargs]
    if node.args.kwarg:
        names.append(node.args.kwarg.arg)
    return [name for name in names if name != "self"]


def test_stubs_name_what_there_is():
    body = stub().body
    classes = {node.name: node for node in body if isinstance(node, ast.ClassDef)}
    functions = {node.name: node for node in body if isinstance(node, ast.FunctionDef)}
    constants = {node.target.id for node in body if isinstance(node, ast.AnnAssign)}
    assert public(classes) | public(functions) | public(constants) == set(volalign.__all__)
    for name, node in classes.items():
        there = public(vars(getattr(volalign, name)))
        assert public(item.name for item in node.body if isinstance(item, ast.FunctionDef)) == there, name
    for name, node in functions.items():
        for argument in arguments(node):
            assert re.search(rf"\b{'kwargs' if argument == 'keywords' else argument}\b", getattr(volalign, name).__doc__), (name, argument)


def test_everything_is_documented():
    for name in volalign.__all__:
        thing = getattr(volalign, name)
        if inspect.isclass(thing) or callable(thing):
            assert thing.__doc__ and len(thing.__doc__.splitlines()) >= 1, name


def test_marked_as_typed():
    import os

    assert os.path.exists(os.path.join(os.path.dirname(volalign.__file__), "py.typed"))
