"""Kernels that only other kernels call: no machine code of their own, no way in from Python, one signature each.

Numba gives every function that it compiles a wrapper for Python, optimises it together with all that it calls, and makes
machine code of that; whoever calls it does the same with all of it again. Most of the time before the first mesh went
there. An inner kernel stays what it is lowered to, and is optimised where it ends up: in the kernels that Python calls.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering


class Library(JITCodeLibrary):
    """A kernel's code, and that of all inner kernels that it calls, each linked once."""

    def add_linking_library(self, library: CodeLibrary) -> None:
        """Link a callee, and what it calls."""
        library._ensure_finalized()
        more = library._linking_libraries if isinstance(library, InnerLibrary) else []
        self._linking_libraries = list(dict.fromkeys([*self._linking_libraries, library, *more]))

    def _optimize_functions(self, ll_module: Any) -> None:
        # As inherited, which sets a pass manager up for every function, declarations too.
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)


class InnerLibrary(Library):
    """Code to be linked into that of callers; no machine code is made of it."""

    def finalize(self) -> None:
        """Leave everything to the callers."""
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(NativeLowering):
    """Lower a kernel into a :class:`Library`, and make machine code of it."""

    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        """Numba's pass, with a library of another class."""
        state.library = Library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


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


class KernelCompiler(CompilerBase):
    """Numba's pipeline with another lowering in it."""

    lowering: type[NativeLowering] = Lowering

    def define_pipelines(self) -> list[PassManager]:
        """The one pipeline."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (self.lowering if step is NativeLowering else step, text) for step, text in pipeline.passes
        ]
        pipeline.finalize()
        return [pipeline]


class InnerCompiler(KernelCompiler):
    """The pipeline of inner kernels."""

    lowering = InnerLowering


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

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], pipeline: type[CompilerBase] = KernelCompiler
    ) -> None:
        super().__init__(function, targetoptions=options | {"no_cfunc_wrapper": True}, pipeline_class=pipeline)

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
        general = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template([types.unliteral(kind) for kind in args], general)


class InnerKernel(Kernel):
    """A kernel for other kernels; called from Python, which tests do, it is compiled once more for that."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any], door: Callable[[], Kernel]) -> None:
        super().__init__(function, options, InnerCompiler)
        self._open = door
        self._door: Kernel | None = None

    def __call__(self, *args: Any, **kws: Any) -> Any:
        if self._door is None:
            self._door = self._open()
        return self._door(*args, **kws)

    def add_overload(self, cres: Any) -> None:
        """Remember a compilation; there is nothing that Python could call."""
        self.overloads[tuple(cres.signature.args)] = cres
