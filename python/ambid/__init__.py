"""ambid: parameters of active magnetic bearings from the machine's own closed loop.

Every public name is listed in ``__init__.pyi``; the room that it comes from is opened when it is first used.
"""

import lazy_loader

_open, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version  # not at the top: it is most of what `import ambid` would take

        return version("ambid")
    return _open(name)
