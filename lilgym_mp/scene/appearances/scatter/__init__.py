"""Scatter: items anywhere in the boxes, added and removed at the cells of a grid."""
