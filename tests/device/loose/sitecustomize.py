"""Python imports this before anything else where its folder is on PYTHONPATH.

Kernels of `twin` compute as compilers like it, and differ from device to device: products and sums
are fused, a GPU divides and takes roots quickly, sines, exponentials and the like are those of
libraries, and of faces at one distance the first one counts. That was the arithmetic before
decision record 0033. The steps by which a ray of a LiDAR has the bits of a packet stay.
"""

import importlib.abc
import importlib.machinery
import sys

UNFUSED, FUSED = '"fuse_fp": False', '"fuse_fp": True'
OWN = ["sin", "cos", "tan", "atan", "atan2", "asin", "acos", "exp", "log", "pow", "tanh"]
SHORT = ["sin", "cos", "asin", "atan2", "log", "pow", "exp"]

LIBRARIES = "\nimport warp as wp\n" + "\n".join(
    [f"portable_{name} = wp.{name}" for name in OWN]
    + [f"portable_{name}_f32 = wp.{name}" for name in SHORT]
)
"""Written behind a module: its functions are those of Warp."""

CHANGES = {
    "twin.render.build": [(UNFUSED, '"fuse_fp": True, "fast_math": self.block > 1')],
    "twin.base.portable.quick": [
        ("const float r = one_over(b);", "return a / b; const float r = one_over(b);"),
        ('asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(b));', "return 1.0f / b;"),
        ('asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(x));', "return wp::sqrt(x);"),
        (": __builtin_sqrtf(x)", ": wp::sqrt(x)"),
        ("const float x = exponent <", "return wp::exp(-exponent); const float x = exponent <"),
    ],
    "twin.render.trace.traverse": [
        ("TWIN_DIV(a, b) a_over_b(a, b)", "TWIN_DIV(a, b) __fdividef(a, b)"),
        ("slack = 1.00390625f", "slack = 1.0f"),
    ],
    "twin.render.trace.four": [
        ("(t < far || (t == far && TWIN_BITS(P.w) < best))", "t < far"),
    ],
}
"""By module: text, and what stands there instead. Lines keep their numbers, since Warp reads the
text of its functions from the file."""


class _Loose(importlib.machinery.SourceFileLoader):
    """Loads a module with changes, and keeps nothing of it."""

    def get_code(self, fullname):
        path = self.get_filename(fullname)
        text = self.get_data(path).decode()
        for here, instead in CHANGES.get(fullname, ()):
            if here not in text:
                raise RuntimeError(f"{fullname} has no '{here}': its arithmetic is not the old one")
            text = text.replace(here, instead)
        text = text.replace(UNFUSED, FUSED)
        if fullname == "twin.base.portable_math":
            text += LIBRARIES
        return self.source_to_code(text.encode(), path)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the modules of `twin`."""

    def find_spec(self, fullname, path=None, target=None):
        if not fullname.startswith("twin."):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Loose(spec.loader.name, spec.loader.path)
        return spec


sys.meta_path.insert(0, _Finder())
