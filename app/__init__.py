"""Breakaway: open-loop control through dry friction and stiction, served over HTTP."""
