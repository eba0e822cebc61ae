"""Named physical effects, which models include and searches try.

An effect is an entry, which says all there is to know of it, and a function, its ``apply``, beside
it. Its arguments, docstring, card, the lists of the documentation and the names of the command line
follow from the entry: one is added in one of the files that ``catalogue`` lists, and in the
``__all__`` of that file.
"""

from .base import Effect
from .catalogue import catalogue  # which fills the registry of ids
from .composition import Effects
from .entry import Argument
from .error_scan import ErrorScan
from .free_form import FreeForm
from .free_forms import *
from .free_forms import __all__ as _of_free_forms
from .in_time import *
from .in_time import __all__ as _in_time
from .machines import *
from .machines import __all__ as _of_machines
from .maps import *
from .maps import __all__ as _of_maps
from .parameter import CoreKind, Dimension, Parameter
from .paths import *
from .paths import __all__ as _of_paths
from .record import Signature
from .registry import effect, title_of, titles_of
from .tremor import Tremor

__all__ = [
    "Argument",
    "CoreKind",
    "Dimension",
    "Effect",
    "Effects",
    "ErrorScan",
    "FreeForm",
    "Parameter",
    "Signature",
    "Tremor",
    "catalogue",
    "effect",
    "title_of",
    "titles_of",
]
__all__ += _in_time
__all__ += _of_maps
__all__ += _of_paths
__all__ += _of_machines
__all__ += _of_free_forms
