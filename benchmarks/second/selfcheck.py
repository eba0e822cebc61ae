"""Check the trial itself: the simulated loop against theory, and stand-ins of known worth.

    python -m benchmarks.second.selfcheck

Open it when the simulator is changed. It stops with what was wrong; of the search it says nothing.
"""

import numpy as np

from . import standins
from .cases import DRAWN, STRANGE_GAP, Case, build
from .elements import NAMES
from .forms_strange import HELD_BACK, STRANGE
from .judge import judge
from .linear import gap
from .loop import RATE
from .world import DT


def loop_error(case: Case) -> float:
    """Largest relative error of x/f and u/f at three sines against L/(1 + L) and H/(1 + L)."""
    world = case.world.clean()
    n = int(120 * RATE)
    t, omega = np.arange(n) * DT, 2 * np.pi * np.array([0.1, 0.4, 0.8])
    run = world.runs[0]
    run.f = np.sin(omega[:, None] * t).sum(0)
    run.d = run.noise_before = run.noise_after = np.zeros(n)
    run.start = np.zeros(2)
    world.runs = [run.fresh(world.person.delay)]
    half = slice(n // 2, n)
    waves = np.exp(-1j * omega[:, None] * t[half])
    closed = world.simulate()[0]
    f, x, u = ((waves * s[half]).mean(1) for s in (run.f, closed[:, 0], closed[:, 2]))
    person, element = world.person.response(omega), world.element.response(omega)
    loop = person * element
    errors = np.abs([x / f / (loop / (1 + loop)) - 1, u / f / (person / (1 + loop)) - 1])
    return float(errors.max())


def yardstick(case: Case) -> float:
    """Points of VAF that the best linear person misses of a linear person: none."""
    world, person = case.world, case.world.person
    e = [world.runs[i].f[:: world.step] - case.closed[i][:: world.step, 0] for i in range(2)]
    u = [case.answers[i][:: world.step] for i in range(2)]
    return gap(e, u, 1 / world.rate, (person.delay, person.omega, person.zeta))


def demand(holds: bool, otherwise: str) -> None:
    """Stop with what was wrong."""
    if not holds:
        raise SystemExit(otherwise)


def check_loop(name: str) -> None:
    """A linear case of the element against theory."""
    case = build("null", name, 3)
    off, left = 100 * loop_error(case), yardstick(case)
    demand(off < 2.0, f"{name}: the loop is {off:.1f} % from theory")
    demand(left < 0.05, f"{name}: the yardstick misses {left:.2f} points of a linear person")
    print(f"{name}: loop within {off:.2f} %, linear person to {left:.4f} points")


def check_standins(case: Case) -> None:
    """The oracle is right, the deaf are not, and who cheats is caught."""
    knows, deaf, cheats = (
        judge(case, who, with_baseline=False)
        for who in (standins.oracle, standins.deaf, standins.inverse)
    )
    right = knows.get("right", True) and knows["tau_covered"] and not knows["false_names"]
    demand(right, f"the oracle is wrong: {knows}")
    demand(not deaf.get("right", False), f"the deaf are right: {deaf}")
    demand(not (knows["leak"] or deaf["leak"]), f"caught, and does not cheat: {knows} {deaf}")
    demand(cheats["leak"], f"the plant's inverse is not caught: {cheats}")


def check_strange(suite: str, seed: int) -> None:
    """Built twice alike, with the gap asked for; ``unknown`` is right, and a name is not."""
    case, again = (build(suite, DRAWN, seed) for _ in range(2))
    least, most = STRANGE_GAP[case.strength]
    demand(least <= case.gap <= most, f"{suite} {seed}: a gap of {case.gap:.1f} points")
    same = case.tables()[0].equals(again.tables()[0]) and case.hidden is again.hidden
    demand(same, f"{suite} {seed}: built twice, and not alike")
    knows = judge(case, standins.oracle, with_baseline=False)
    demand(knows["right"] and not knows["false_names"], f"the oracle is wrong: {knows}")


def main() -> None:
    """Run all checks."""
    for name in NAMES:
        check_loop(name)
    for name in NAMES[:2]:
        for seed in (1, 2):
            check_standins(build("leaks", name, seed))
    for suite, forms in (("strange", STRANGE), ("held_back", HELD_BACK)):
        for seed in range(len(forms)):
            check_strange(suite, seed)
        print(f"{suite}: {len(forms)} forms, built alike, with the gap asked for")
    print("stand-ins: the oracle is right, the deaf are not, the plant's inverse is caught")


if __name__ == "__main__":
    main()
