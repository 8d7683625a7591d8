"""The validation and a pull, live: manoeuvre, recording by the service, the same judgement as offline."""

import numpy as np

from estimator.specimen import load_specimen
from service.experiments.bench import laboratory_of
from service.experiments.force_rows import PUBLISHED, PullCase, along_cord_row, follow_pull
from service.experiments.holds import hold_windows
from service.experiments.live import LiveBench
from service.experiments.live_runs import pull_steps, validate_live
from service.experiments.operator import FakeOperator


def test_poses_and_pulls_are_recorded_where_the_experiment_led_the_arm(client, fakes, rig):
    specimen = load_specimen(rig.settings.specimen)
    bench = LiveBench(client, FakeOperator(fakes, laboratory_of(fakes)), specimen)
    with client.lease():
        poses = validate_live(bench, seed=3, poses=2)
        with bench.recording("pull") as paths:
            bench.wait(1.0)
            pull_steps(bench, "tip", turns=(0.5,), steps=3, travel=0.03, rest_s=1.3)
        pulls = bench.load(paths[0])
    assert len(hold_windows(poses, shortest=2.0)) >= 2
    assert {"base", "intermediate", "tip"} <= set(poses.frames)
    done = follow_pull(PullCase("not pressurised", pulls, specimen), at_rest=True)
    row = along_cord_row(done, PUBLISHED["not pressurised"])
    assert row["section"] == "tip"
    assert np.ptp(done.errors.gauge) > 0.05
    assert np.nanmax(np.abs(done.errors.error)) < 0.15 * np.ptp(done.errors.gauge)
