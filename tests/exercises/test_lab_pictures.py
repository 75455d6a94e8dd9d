"""The picture after a lab: yours beside the library's, also when it fails."""

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")

from slamlab.commands._process import Process
from slamlab.exercises.lab_pictures import draw, replay
from slamlab.exercises.lab_systems import systems
from slamlab.exercises.labs import practice
from slamlab.localization import DeadReckoning


def texts(figure):
    return [text.get_text() for ax in figure.axes for text in ax.texts]


def true_room(setting, log):
    """Return what the library draws along the true poses: a student cannot know them."""
    task = next(t for t in practice("II") if t.setting.name == setting.name)
    return systems("II", task)["(grid, true poses)"]()


def test_the_right_room_looks_as_it_should():
    figure = draw("II", true_room)
    assert len(figure.axes) == 4
    for left, right in (figure.axes[:2], figure.axes[2:]):
        yours, theirs = left.images[0], right.images[0]
        np.testing.assert_array_equal(yours.get_array(), theirs.get_array())
        assert yours.get_extent() == theirs.get_extent()
        assert left.get_xlim() == right.get_xlim()
    assert texts(figure) == []


def test_a_room_that_is_wrong_looks_wrong():
    def shifted(setting, log):
        probability, side, corner = true_room(setting, log)
        return probability.T, side, corner + 1.0

    figure = draw("II", shifted)
    left, right = figure.axes[:2]
    assert left.images[0].get_extent() != right.images[0].get_extent()
    assert left.get_xlim() == right.get_xlim()
    assert len(left.lines) == len(right.lines) == len(practice("II")[0].world.segments)
    figure.canvas.draw()


def raising(setting, log):
    raise KeyError("lost")


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (raising, "cannot be drawn: KeyError: 'lost'"),
        (lambda setting, log: None, "cannot be drawn: TypeError"),
        (lambda setting, log: (np.zeros(5), 0.1, [0, 0]), "cannot be drawn: "),
        (lambda one: one, "cannot be drawn: TypeError"),
    ],
)
def test_whatever_comes_is_said_and_the_right_room_is_drawn(system, message):
    figure = draw("II", system)
    said = texts(figure)
    assert len(said) == 2
    assert all(text.startswith(message) for text in said)
    assert all(len(ax.images) == 1 for ax in figure.axes[1::2])


@pytest.mark.parametrize(("lab", "rows"), [("I", 3), ("III", 3)])
def test_a_run_is_drawn_beside_truth_and_odometry(lab, rows):
    figure = draw(lab, lambda s: DeadReckoning(s.motion, s.start, s.start_cov))
    assert len(figure.axes) == 2 * rows
    assert texts(figure) == []
    for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
        odometry, yours = (left.lines[k].get_xydata() for k in (-3, -1))
        np.testing.assert_allclose(yours, odometry, atol=1e-9)
        assert np.abs(right.lines[-1].get_xydata() - odometry).max() > 0.2
        assert len(left.patches) == 12


def test_a_drive_is_drawn_with_what_the_robot_believed():
    class Timid:
        measures = "scan"

        def __init__(self, setting):
            self.pose, self.pose_cov = setting.start.copy(), setting.start_cov.copy()

        def predict(self, u, dt, control_cov):
            self.pose = self.pose + [0.5, 0, 0]  # it believes to fly

        def update(self, ranges):
            pass

        def command(self, view):
            return [0.1, 0.0, 0.0] if view.time < 1.0 else None

    left = draw("IV", Timid).axes[0]
    true, believed = (left.lines[k].get_xydata() for k in (-3, -2))
    assert np.ptp(true, axis=0).max() < 0.2
    assert np.ptp(believed[:, 0]) > 1.0


@pytest.mark.parametrize("lab", ["I", "III"])
def test_a_run_is_replayed_and_saved_as_one_file(lab, tmp_path):
    shown = replay(lab, lambda s: DeadReckoning(s.motion, s.start, s.start_cov), drive=1)
    arrays = shown.payload["arrays"]
    assert {"truth", "estimate", "dead_reckoning", "ellipses"} <= set(arrays)
    paths = [str(arrays[name]) for name in ("estimate", "dead_reckoning", "truth")]
    assert paths[0] == paths[1] != paths[2]
    page = shown.save(tmp_path / "my_drive.html").read_text(encoding="utf-8")
    assert "canvas" in page
    assert "https://" not in page, "it needs no network"
    assert "src=" not in page, "and no other file"


def test_a_room_and_a_drive_are_replayed():
    shown = replay("II", true_room)
    assert shown.payload["maps"]
    assert "scans" in shown.payload["arrays"]

    class Still:
        measures = "scan"

        def __init__(self, setting):
            self.pose, self.pose_cov = setting.start.copy(), setting.start_cov.copy()

        def predict(self, u, dt, control_cov):
            pass

        def update(self, ranges):
            pass

        def command(self, view):
            return [0.1, 0.0, 0.0] if view.time < 1.0 else None

    assert {"truth", "estimate", "scans"} <= set(replay("IV", Still).payload["arrays"])


@pytest.mark.parametrize(
    ("words", "said"), [(("V", print), "lab: "), (("I", print, 0, 3), "drive: expected 0 to 2")]
)
def test_a_replay_of_no_lab_and_of_no_drive_is_refused(words, said):
    with pytest.raises(ValueError, match=said):
        replay(*words)


def test_another_lab_is_refused_with_a_sentence():
    with pytest.raises(ValueError, match="lab: expected one of 'I'"):
        draw("V", lambda *_: None)


def test_a_submission_draws_nothing():
    """The picture is not for the process of a submission, which knows no truth."""
    code = "from slamlab.exercises.lab_pictures import draw\nkept = draw('II', print)"
    with Process([code], 20.0, 2048, ("slamlab.slam", "slamlab.commands")) as process:
        assert process.notes == []
