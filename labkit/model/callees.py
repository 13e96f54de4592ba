"""Numba's compiler for functions that only compiled code calls: machine code is generated in their callers alone.

A first run therefore compiles less. This module uses private names of Numba, which another version may lack.
"""

from __future__ import annotations

import importlib

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, StateDict
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import NativeLowering

FUNCTIONS = importlib.import_module("numba._dynfunc")  # a module in C, without types


class CalleeCode(JITCodeLibrary):
    """Code that other code is linked to."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class CalleeLowering(NativeLowering):
    """Numba's last pass, without machine code."""

    _name = "callee_lowering"

    def run_pass(self, state: StateDict) -> bool:
        """Translate a function into code for LLVM, and give its callers an object that identifies it."""
        state.library = CalleeCode(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        known = state.cr.fndesc
        mark = FUNCTIONS.make_function(known.lookup_module(), known.qualname, "", 0, state.cr.env, (state.library,))
        state.targetctx.insert_user_function(mark, known, [state.library])
        state.cr = state.cr._replace(cfunc=mark)
        return True


class CalleeCompiler(CompilerBase):
    """Numba's compiler with this last pass."""

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.passes = [(CalleeLowering if kind is NativeLowering else kind, what) for kind, what in passes.passes]
        passes.finalize()
        return [passes]
