"""`breakaway bench`: speed, as ratios and medians measured side by side in one run.

The plain references that ours is measured against live in reference.py and planning.py.
"""
