"""`warm` leaves nothing to compile."""

from slamlab.commands import main
from slamlab.filters import _sweeps
from slamlab.navigation import _boxes, _spline
from slamlab.sensors import _march
from slamlab.slam import _gamma_kernels, _grid_kernels
from slamlab.worlds import _cast


def test_warm_runs_every_kind_of_compiled_loop_and_says_how_long(capsys):
    assert main(["warm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6
    assert all(line.endswith(" s") for line in lines)
    for module in (_sweeps, _boxes, _spline, _cast, _march, _gamma_kernels, _grid_kernels):
        loops = [v for v in vars(module).values() if hasattr(v, "signatures")]
        assert any(loop.signatures for loop in loops), module
