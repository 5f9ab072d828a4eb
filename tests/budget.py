"""What a run of the tests costs, counted in what any machine counts alike; time is shown, and judges nothing.

Counted are evaluations of the compiled core, processes that are started, and pictures that are drawn. What a fixture of
a module or a session costs is counted once, however many workers make it, and not with the test that came first.
`pytest --budget` fails where the fast tier passes `BUDGETS`: what costs most belongs into the slow tier, or shares a
result with others.
"""

import functools
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
from matplotlib.figure import Figure

import ambid._core as core

EVALUATIONS, PROCESSES, PICTURES = "evaluations", "processes", "pictures"


@dataclass(frozen=True)
class Budget:
    """The most that one test, and a whole run of the fast tier, may take of something."""

    one: int
    all: int


BUDGETS = {
    EVALUATIONS: Budget(10_000, 250_000),
    PROCESSES: Budget(10, 35),
    PICTURES: Budget(30, 48),
}
"""About a fifth more than the fast tier took when they were set."""
OUTSIDE = "outside"
"""The account of what no test does, such as collecting them."""
SHOWN = 20
"""So many of the slowest tests are listed."""
MANY = 200
"""A run of fewer tests lists none."""


class Meter:
    """What has been spent, by account: a test, or a fixture that several share."""

    def __init__(self) -> None:
        self._accounts = [OUTSIDE]
        self._spent: dict[str, Counter[str]] = {}

    def charge(self, what: str, number: float = 1) -> None:
        """Charge the account that was opened last."""
        self._spent.setdefault(self._accounts[-1], Counter())[what] += number

    @contextmanager
    def account(self, name: str) -> Iterator[None]:
        """Charge this account with what is done inside."""
        self._accounts.append(name)
        try:
            yield
        finally:
            self._accounts.pop()

    def take(self) -> dict[str, dict[str, float]]:
        """What has been spent since the last call, by account."""
        spent, self._spent = self._spent, {}
        spent.pop(OUTSIDE, None)
        return {name: dict(own) for name, own in spent.items()}


METER = Meter()


def watch() -> None:
    """Charge evaluations of the core, processes and pictures from here on; a single step of time is none."""
    for owner in (core, core.ClosedLoop, core.LineData, core.Stepper):
        for name, own in list(vars(owner).items()):
            if callable(own) and not isinstance(own, type) and not name.startswith("_") and name != "step":
                setattr(owner, name, charged(own, EVALUATIONS, evaluations_of))
    Figure.savefig = charged(Figure.savefig, PICTURES)  # type: ignore[method-assign]
    sys.addaudithook(_hear)


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    """Charge a process of Python; what libraries ask of the system, once on most machines, is none."""
    if event == "subprocess.Popen" and any("python" in str(word) for word in arguments[1][:1]):
        METER.charge(PROCESSES)


def charged(function: Callable[..., Any], what: str, number: Callable[[Any], int] = lambda result: 1) -> Any:
    """A function whose calls are charged."""

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        result = function(*arguments, **options)
        METER.charge(what, number(result))
        return result

    return call


def evaluations_of(result: Any) -> int:
    """One a call; of `fit_all` those of each fit that ended."""
    is_many = isinstance(result, list) and bool(result) and isinstance(result[0], dict | Exception)
    return sum(fit["evaluations"] if isinstance(fit, dict) else 1 for fit in result) if is_many else 1


class Ledger:
    """What every test and shared fixture of a run has cost, whichever worker made it."""

    def __init__(self, judges: bool) -> None:
        self.judges = judges
        self.costs: dict[str, dict[str, float]] = {}
        self.took: Counter[str] = Counter()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Enter a report, of this process or of a worker."""
        self.took[report.nodeid] += report.duration
        for name, cost in getattr(report, "cost", {}).items():
            known = self.costs.setdefault(name, {})
            known |= {what: max(number, known.get(what, 0)) for what, number in cost.items()}

    def passed(self) -> Iterator[str]:
        """Every budget that was passed, with what it went into."""
        for what, budget in BUDGETS.items():
            spent = Counter({name: cost.get(what, 0) for name, cost in self.costs.items()})
            for name, own in spent.items():
                if own > budget.one:
                    yield f"{name}: {own:.0f} {what}, at most {budget.one} in a test"
            if spent.total() > budget.all:
                most = ", ".join(name for name, _ in spent.most_common(5))
                yield f"{spent.total():.0f} {what} in the run, at most {budget.all}; most in {most}"

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Let the run fail."""
        if self.judges and any(self.passed()):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """List the slowest tests of a large run, what it has cost, and the budgets that it passed."""
        if len(self.took) >= MANY:
            terminalreporter.section(f"slowest {SHOWN}")
            for name, took in self.took.most_common(SHOWN):
                cost = self.costs.get(name, {})
                terminalreporter.write_line(f"{took:7.2f} s {cost.get(EVALUATIONS, 0):7.0f} evaluations  {name}")
            terminalreporter.section("budget of the fast tier")
            for what, budget in BUDGETS.items():
                total = sum(cost.get(what, 0) for cost in self.costs.values())
                terminalreporter.write_line(f"{total:8.0f} of {budget.all:7d} {what}")
        for line in self.passed() if self.judges else ():
            terminalreporter.write_line(f"budget: {line}", red=True)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--budget`."""
    parser.addoption("--budget", action="store_true", help="fail where the run passes the budget of the fast tier")


def pytest_configure(config: pytest.Config) -> None:
    """Count from here on."""
    watch()
    config.pluginmanager.register(Ledger(config.getoption("budget")), "ledger")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Open the account of a test."""
    with METER.account(item.nodeid):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: Any) -> Iterator[None]:
    """Open that of a fixture which other tests may share."""
    if fixturedef.scope == "function":
        return (yield)
    with METER.account(f"{request.node.nodeid}::{fixturedef.argname}[{getattr(request, 'param_index', 0)}]"):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Put what was spent into the last report of a test, which takes it to the controller."""
    report = yield
    if call.when == "teardown":
        report.cost = METER.take()
    return report
