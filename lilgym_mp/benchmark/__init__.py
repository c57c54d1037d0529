"""Benchmarks of the environments' speed: all ways to run them play the same fixed workload."""

from lilgym_mp.benchmark.catalogue import GROUPS, benchmark_cases
from lilgym_mp.benchmark.measuring import EFFORTS, Bench, Effort, Measurement
from lilgym_mp.benchmark.traces import Workload

__all__ = ["EFFORTS", "GROUPS", "Bench", "Effort", "Measurement", "Workload", "benchmark_cases"]
