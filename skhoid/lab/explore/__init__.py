"""Compare, see where, try an effect, watch the error fall: by hand.

``Exploration`` is the engine (a model of recorded runs that is changed step by step), ``static``
the component that people touch: one script without a framework, the same in the report, in
notebooks and in ``skhoid workbench``. Open ``exploration`` to change what a step does, ``view`` for
what the component is told, ``payloads`` for how it travels, ``component`` for pages and notebooks.
"""

from .exploration import Exploration

__all__ = ["Exploration"]
