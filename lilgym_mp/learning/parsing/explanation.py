"""A plan explained in text: candidate programs, their truth, and the actions."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.actions import describe
from lilgym_mp.learning.parsing.parser import truths
from lilgym_mp.learning.parsing.planning import MIN_PROBABILITY, Plan, Planner
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene


def explanation_lines(plan: Plan, planner: Planner, statement: str, target: bool) -> Iterator[str]:
    """The lines of the explanation."""
    parse = plan.parse
    appearance = planner.dynamics.appearance.name
    yield f'task: make "{statement}" {str(target).lower()}'
    yield f"parsed words: {' '.join(parse.words[1:])}"
    if parse.is_guess:
        yield f"note: {parse.unknown} of {len(parse.words) - 1} words are unknown: the parse is a guess"
    if not parse.candidates:
        yield "no program was found"
        return
    yield ""
    yield "candidate programs: probability; truth in this scene; true in % of probe scenes; satisfied by the plan"
    probabilities = {goal.program: goal.probability for goal in plan.goals}
    satisfied = {plan.goals[index].program for index in plan.satisfied}
    for candidate in parse.candidates:
        if candidate.probability < MIN_PROBABILITY:
            continue
        truth = compile_program(candidate.program)
        probed = truths(candidate.program, appearance)
        share = probed.count(True) / len(probed)
        probability = probabilities.get(candidate.program, 0.0)
        fulfilled = "yes" if candidate.program in satisfied else "no"
        here = str(truth(plan.scene)).lower()
        yield f"  {100 * probability:5.1f} %  {here:5}  {100 * share:3.0f} %  {fulfilled:3}  {candidate.program}"
        if truth(plan.scene) == target:
            yield "           (unlikely: the start scene would already be a success)"
    yield ""
    yield f"plan: {', '.join(map(describe, plan.actions))}"
    yield f"predicted probability of success: {100 * plan.success_probability:.0f} %"


def scenes_of(plan: Plan, planner: Planner) -> list[Scene]:
    """The scenes along the plan, the first included."""
    dynamics, scenes = planner.dynamics, [plan.scene]
    for action in plan.actions[:-1]:
        scenes.append(dynamics.appearance.apply(scenes[-1], action, dynamics.rules.placement).scene)
    return scenes
