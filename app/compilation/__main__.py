"""`python -m app.compilation TITLE FUNCTION [FOLDER]`: one part, in a process of its own.

With a folder, the kernels that are noted there, for the processor that Numba's variables name.
"""

import sys
from pathlib import Path

from app.compilation.parts import Part

title, function, *kept = sys.argv[1:]
if kept:
    Part(title, function).compile_again(Path(*kept))
else:
    Part(title, function).compile()
