"""Recordings of evaluations, as `lilgym-mp evaluate --record` makes them."""

from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.evaluation.recording import Recorder
from lilgym_mp.evaluation.results import play, training_statements


def record(directory, named, plan, **options):
    """The recording of a policy; `options`: of the recorder."""
    seen = training_statements(plan.settings)
    recorder = Recorder(plan.settings, plan.split, seen, **options)
    return read_episodes(recorder.write(directory, play(named, plan, seen)))
