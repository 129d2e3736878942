"""What becomes of a mutant: the test that catches it, or that none does."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mutants.covering import Covering, order_tests
from mutants.functions import digest_test
from mutants.mutant import Mutant
from mutants.trial import Trial

CAUGHT, SURVIVED, NOT_COVERED, GONE = "caught", "survived", "not covered", "gone"
#: Of a mutant: how many tests try it, how long they take together, and how many do in any case.
MOST_TESTS, MOST_S, LEAST_TESTS = 200, 60.0, 5
#: How often a test may fail that also fails without the mutant; it is left out then.
MOST_FALSE = 4


@dataclass(frozen=True)
class Verdict:
    mutant: Mutant
    outcome: str
    test: str = ""  # that caught it
    digest: str = ""  # of that test
    covering: int = 0  # tests that run its lines
    tried: int = 0  # of them
    library: str = ""  # what became of that of compiled functions
    seconds: float = 0.0
    failing: tuple[str, ...] = ()  # tests that fail without it, too

    @property
    def is_doubtful(self) -> bool:
        """Whether tests that might catch it failed without it, too: on a machine that is busy."""
        return self.outcome == SURVIVED and bool(self.failing)

    def to_json(self) -> str:
        return json.dumps(asdict(self), ensure_ascii=False)


def read_verdicts(path: Path) -> list[Verdict]:
    """One for each mutant: the last that was written."""
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    verdicts = (
        Verdict(**row | {"mutant": Mutant(**row["mutant"]), "failing": tuple(row["failing"])})
        for row in rows
    )
    return list({verdict.mutant.name: verdict for verdict in verdicts}.values())


def judge(mutant: Mutant, covering: Covering, trial: Trial) -> Verdict:
    """Try the mutant; a test that catches it passes again once it is gone."""
    start = time.monotonic()
    tests = covering.find_tests(mutant)
    chosen = choose_tests(tests, covering)
    if not chosen:
        return Verdict(mutant, NOT_COVERED)
    owner = covering.names.owner(mutant.path, mutant.line)
    is_compiled = owner is not None and bool(owner.names)
    failing = set[str]()
    while True:
        remaining = [test for test in chosen if test not in failing]
        with trial.change(mutant, is_compiled) as change_of_library:
            library = change_of_library
            caught = trial.find_catching(remaining, compiles=library not in ("", "kept"))
        if not caught:
            break
        again = [test for test in remaining if test == caught or test.startswith(f"{caught}::")]
        if not trial.find_catching(again[:1]):
            break
        failing |= set(again)
        if len(failing) > MOST_FALSE:
            caught = ""
            break
    return Verdict(
        mutant,
        outcome=CAUGHT if caught else SURVIVED,
        test=caught,
        digest=digest_test(trial.copy.root, caught) if caught else "",
        covering=len(tests),
        tried=len(remaining),
        library=library,
        seconds=round(time.monotonic() - start, 1),
        failing=tuple(sorted(failing)),
    )


def choose_tests(tests: set[str], covering: Covering) -> list[str]:
    chosen: list[str] = []
    total_s = 0.0
    for test in order_tests(tests, covering.seconds):
        total_s += covering.seconds[test]
        if len(chosen) >= LEAST_TESTS and (len(chosen) == MOST_TESTS or total_s > MOST_S):
            break
        chosen.append(test)
    return chosen


def needs_trial(earlier: Verdict, covering: Covering, root: Path) -> bool:
    """Whether the test that caught a mutant is gone or changed since."""
    if earlier.outcome != CAUGHT:
        return False
    same = digest_test(root, earlier.test) == earlier.digest
    return not (same and earlier.test in covering.seconds)


def print_table(verdicts: Sequence[Verdict]) -> None:
    """A row for each package, then which test caught each mutant."""
    outcomes = [CAUGHT, SURVIVED, NOT_COVERED]
    if any(verdict.outcome == GONE for verdict in verdicts):
        outcomes.append(GONE)
    print(f"{'':14s}{'drawn':>12s}" + "".join(f"{outcome:>12s}" for outcome in outcomes))
    rooms = sorted({verdict.mutant.room for verdict in verdicts})
    for title, chosen in [*((room, {room}) for room in rooms), ("all", set(rooms))]:
        own = [verdict.outcome for verdict in verdicts if verdict.mutant.room in chosen]
        counts = [len(own), *(own.count(outcome) for outcome in outcomes)]
        print(f"{title:14s}" + "".join(f"{n:12d}" for n in counts))
    print()
    for verdict in sorted(verdicts, key=lambda one: (one.mutant.path, one.mutant.line)):
        print(f"{verdict.mutant.describe()}\n    {verdict.test or verdict.outcome}")
