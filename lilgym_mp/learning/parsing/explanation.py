"""What the agent makes of a statement, for people: candidate programs, what each is true of, the plan."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.actions import describe
from lilgym_mp.learning.parsing.parser import probe_scenes
from lilgym_mp.learning.parsing.planning import LEAST_PROBABILITY, Plan, Planner
from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene


def explanation_lines(plan: Plan, planner: Planner, statement: str, target: bool) -> Iterator[str]:
    """Lines that tell how a plan came about."""
    parse = plan.parse
    appearance = planner.dynamics.appearance.name
    yield f'"{statement}" is to become {str(target).lower()}'
    yield f"read as: {' '.join(parse.words[1:])}"
    if parse.is_guess:
        yield f"note: {parse.unknown} of {len(parse.words) - 1} words are unknown: what follows is a guess"
    if not parse.candidates:
        yield "no program was found"
        return
    yield ""
    yield "candidate programs: probability; truth in this scene; share of scenes it is true of; met by the plan"
    probabilities = {goal.program: goal.probability for goal in plan.goals}
    satisfied = {plan.goals[index].program for index in plan.satisfied}
    for candidate in parse.candidates:
        if candidate.probability < LEAST_PROBABILITY:
            continue
        truth = compile_program(candidate.program)
        scenes = probe_scenes(appearance)
        share = sum(truth.evaluate(scene) for scene in scenes if _has_value(candidate.program, scene)) / len(scenes)
        probability = probabilities.get(candidate.program, 0.0)
        met = "met" if candidate.program in satisfied else "not met"
        here = str(truth(plan.scene)).lower()
        yield f"  {100 * probability:5.1f} %  {here:5}  {100 * share:3.0f} %  {met:7}  {candidate.program}"
        if truth(plan.scene) == target:
            yield "           (unlikely here: the start would be a success already)"
    yield ""
    yield f"plan: {', '.join(map(describe, plan.actions))}"
    yield f"stated probability of success: {100 * plan.success_probability:.0f} %"


def _has_value(program: str, scene: Scene) -> bool:
    """Whether the program has a truth in the scene; False where it raises an error."""
    try:
        compile_program(program).evaluate(scene)
    except ProgramRuntimeError:
        return False
    return True


def scenes_of(plan: Plan, planner: Planner) -> list[Scene]:
    """The scenes that the plan goes through, the first included."""
    dynamics, scenes = planner.dynamics, [plan.scene]
    for action in plan.actions[:-1]:
        scenes.append(dynamics.appearance.apply(scenes[-1], action, dynamics.rules.placement).scene)
    return scenes
