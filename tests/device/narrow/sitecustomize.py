"""Python imports this before anything else where its folder is on PYTHONPATH.

Kernels that Warp compiles for the CPU take no instruction that a processor of 2013 with AVX2 and
FMA lacks, whatever processor this is. Nothing is loaded for it in a process that does not import
Warp.
"""

import importlib.abc
import importlib.machinery
import sys

NATIVE, NARROW = "-march=native", "-target-cpu haswell"


class _Narrow(importlib.abc.MetaPathFinder):
    """Changes ``warp.config`` when it is loaded."""

    def find_spec(self, fullname, path=None, target=None):
        if fullname != "warp.config":
            return None
        sys.meta_path.remove(self)
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        load = spec.loader.exec_module

        def exec_module(module):
            load(module)
            if NATIVE not in module.cpu_compiler_flags.split():
                raise RuntimeError(
                    f"cpu_compiler_flags of Warp have no {NATIVE}: nothing is hidden"
                )
            module.cpu_compiler_flags = module.cpu_compiler_flags.replace(NATIVE, NARROW)

        spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, _Narrow())
