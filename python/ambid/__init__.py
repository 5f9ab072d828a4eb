"""ambid: parameters of active magnetic bearings from the machine's own closed loop.

Every public name is listed in ``__init__.pyi``; the room that it comes from is opened when it is first used.
"""

from importlib.metadata import version

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("ambid")
