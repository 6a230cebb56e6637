"""Kernels that only other kernels call: no wrapper for Python and no machine code of their own.

Numba gives every function that it compiles a wrapper for Python, optimises it together with all that it calls, and
makes machine code of that; whoever calls it does the same with all of it again. An inner kernel stays what it is
lowered to, and is optimised where it ends up: in the kernels that Python calls. A mesh calls some 15 of 170. That, and
one signature for each, took the time before the first mesh from 70 s to 20 s, of which the rest is Numba's own.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering
from numba.core.types.misc import unliteral


class InnerLibrary(JITCodeLibrary):
    """Code to be linked into that of callers; no machine code is made of it."""

    def finalize(self) -> None:
        """Link what the kernel calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class InnerLowering(NativeLowering):
    """Lower a kernel into an :class:`InnerLibrary`."""

    _name = "inner_lowering"

    def run_pass(self, state: Any) -> bool:
        """Numba's pass up to machine code; callers find the result under a key in place of a function."""
        state.library = InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        super().run_pass(state)
        key = object()
        state.targetctx.insert_user_function(key, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=key)
        return True


class InnerCompiler(CompilerBase):
    """Numba's pipeline with :class:`InnerLowering` in it."""

    def define_pipelines(self) -> list[PassManager]:
        """The one pipeline."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(InnerLowering if step is NativeLowering else step, text) for step, text in pipeline.passes]
        pipeline.finalize()
        return [pipeline]


class MachineCode(FunctionCache):
    """Numba's cache of a function on disk, which may be full or read-only."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compilation if there is a place for it."""
        with suppress(OSError):
            super().save_overload(sig, data)

    def holds(self, codegen: Any) -> bool:
        """Whether there is machine code for this processor."""
        with suppress(OSError):
            return any(processor == codegen.magic_tuple() for _, processor, _ in self._cache_file._load_index())
        return False


class Kernel(CPUDispatcher):
    """A kernel that Python calls, compiled for the types of its arguments only, never for the values of constants."""

    def enable_caching(self) -> None:
        """Keep machine code on disk, if there is a place for it."""
        with suppress(RuntimeError):
            self._cache = MachineCode(self.py_func)

    def is_compiled(self) -> bool:
        """Whether its machine code is loaded or lies on disk."""
        kept = self._cache
        return bool(self.overloads) or (isinstance(kept, MachineCode) and kept.holds(self.targetctx.codegen()))

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """How Numba asks for the code for these types when another kernel calls this one."""
        general = {name: unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template([unliteral(kind) for kind in args], general)


class InnerKernel(Kernel):
    """A kernel for other kernels; called from Python, which tests do, it is compiled once more for that."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], door: Callable[[], Kernel]) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=InnerCompiler)
        self._open = door
        self._door: Kernel | None = None

    def __call__(self, *args: Any, **kws: Any) -> Any:
        if self._door is None:
            self._door = self._open()
        return self._door(*args, **kws)

    def add_overload(self, cres: Any) -> None:
        """Remember a compilation; there is nothing that Python could call."""
        self.overloads[tuple(cres.signature.args)] = cres
