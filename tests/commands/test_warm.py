"""`warm` leaves nothing to compile."""

from slamlab.commands import main
from slamlab.filters import _sweeps
from slamlab.navigation import _boxes, _spline
from slamlab.worlds import _cast


def test_warm_runs_every_kind_of_compiled_loop_and_says_how_long(capsys):
    assert main(["warm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert all(line.endswith(" s") for line in lines)
    for module in (_sweeps, _boxes, _spline, _cast):
        loops = [v for v in vars(module).values() if hasattr(v, "signatures")]
        assert any(loop.signatures for loop in loops), module
