"""How fast the environments are: the same fixed play given to every way of running them, side by side."""

from lilgym_mp.benchmark.catalogue import GROUPS, subjects
from lilgym_mp.benchmark.measuring import EFFORTS, Bench, Effort, Measurement
from lilgym_mp.benchmark.traces import Workload

__all__ = ["EFFORTS", "GROUPS", "Bench", "Effort", "Measurement", "Workload", "subjects"]
