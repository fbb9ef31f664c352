"""Calibrates depth sensors from one still frame each of a stack of boxes. See docs/python.md."""

from . import _volalign

_volalign._use_data_near(__file__)

__version__ = _volalign.__version__
__all__ = [name for name in dir(_volalign) if not name.startswith("_")]
for _name in __all__:
    globals()[_name] = getattr(_volalign, _name)
    if isinstance(globals()[_name], type):
        globals()[_name].__module__ = __name__
