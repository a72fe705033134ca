"""Progress reports: text, fraction, and their rate."""

import time

import numpy as np
import pytest
from rich.progress import Progress as Bars

from qtraj.foundation import progress_bar
from qtraj.foundation.progress import Progress, throttled
from qtraj.foundation.reporting import reporting


@pytest.mark.parametrize(
    ("progress", "text", "fraction"),
    [
        (Progress("searches", 3, 8), "3 of 8 searches", 0.375),
        (Progress("fitting"), "fitting", None),
        (Progress("nothing", 0, 0), "0 of 0 nothing", 0.0),
        (Progress("more", 9, 8), "9 of 8 more", 1.0),
    ],
)
def test_a_report_says_what_and_how_much(progress, text, fraction):
    assert str(progress) == text
    assert progress.fraction == fraction


@pytest.mark.parametrize("step", [0.001, 0.1, 0.3])
def test_the_first_report_is_immediate_and_later_ones_are_limited(step):
    times = step * np.arange(1000)
    clock, seen = iter(times), []
    report = throttled(lambda progress: seen.append(times[progress.done]), interval=0.25, clock=lambda: next(clock))
    for k in range(1000):
        report(Progress("steps", k, 1000))
    assert seen[0] == 0.0
    gaps = np.diff(seen)
    assert gaps.min() >= 0.25
    assert gaps.max() < 0.25 + 2 * step


def test_without_a_receiver_nothing_happens():
    throttled(None)(Progress("searches", 1, 2))


@pytest.mark.parametrize("progress", [None, False])
def test_no_progress_is_reported_unless_wished(progress):
    with reporting(progress) as report:
        assert report is None


def test_progress_is_displayed_in_a_log(monkeypatch, capsys):
    monkeypatch.setattr(progress_bar, "EVERY", 0.1)
    with reporting(True) as report:
        report(Progress("searches", 1, 2))
        time.sleep(0.25)
    assert "tuning: 1 of 2 searches" in capsys.readouterr().err


def test_a_bar_of_an_earlier_stage_disappears():
    """A stage without a known total shows no progress of the stage before, even if that was complete."""
    with Bars() as shown:
        watch = progress_bar.BarWatch(shown)
        watch.tuning(Progress("searches", 8, 8))
        assert shown.tasks[0].finished
        watch.say("writing")
        (task,) = shown.tasks
        assert (task.total, task.completed, task.finished, task.description) == (None, 0, False, "writing")
        watch.tuning(Progress("searches", 1, 4))
        assert task.percentage == 25.0
