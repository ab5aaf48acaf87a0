"""`python -m app.compilation TITLE FUNCTION`: one part, in a process of its own."""

import sys

from app.compilation.parts import Part

Part(*sys.argv[1:]).compile()
