"""What is made of the library: command line, workbench, report, experiments and studies.

Modules here use the public names of what is below them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["experiment", "explore", "report", "studies"]
)
