"""The program language: the meaning of a statement as one expression over the boxes and items of a scene."""

from lilgym_mp.programs.compiler import Program, compile_program
from lilgym_mp.programs.errors import Position, ProgramError, ProgramRuntimeError, StepLimitError
from lilgym_mp.submodules import submodule_getter

__all__ = [
    "Position",
    "Program",
    "ProgramError",
    "ProgramRuntimeError",
    "StepLimitError",
    "compile_program",
]

__getattr__ = submodule_getter(__name__)
