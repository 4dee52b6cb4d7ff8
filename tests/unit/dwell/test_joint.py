"""Several tools as one problem, and the balance of residual and time as one price."""

from __future__ import annotations

import numpy as np
import pytest

from ibfctl.dwell.aim import Aim
from ibfctl.dwell.joint import JointRemoval, joint_problem
from ibfctl.dwell.methods.extension import extended_problem
from ibfctl.dwell.misfit import make_misfit
from ibfctl.dwell.operator import RemovalOperator
from ibfctl.dwell.solver import Descent, DwellProblem, Regularisation
from ibfctl.dwell.trade_off import aim_at
from ibfctl.path.raster import raster
from ibfctl.surface.influence import gaussian
from ibfctl.surface.map import Rectangle, SurfaceMap


def tool_problem(fwhm_mm: float, pitch_mm: float) -> DwellProblem:
    y, x = np.mgrid[-1:1:30j, -1:1:40j]
    surface = SurfaceMap.centred(20 * (x**2 + y**2) + 2 * np.cos(9 * x) * np.cos(6 * y), 0.25)
    tool = gaussian(fwhm_mm, 8.0, 1.2 * fwhm_mm, 0.25)
    path = raster(Rectangle(-5 - fwhm_mm, 5 + fwhm_mm, -3.75 - fwhm_mm, 3.75 + fwhm_mm), pitch_mm, pitch_mm)
    misfit = make_misfit(surface, np.ones(x.shape, dtype=bool), tool, "tilt", 1)
    operator = RemovalOperator(misfit.grid, misfit.influence, path.dwell_x_mm, path.dwell_y_mm)
    n = path.segments
    return DwellProblem(operator, misfit, np.full(n, 0.01), np.full(n, np.inf), path.straight)


@pytest.fixture(scope="module")
def tools() -> tuple[DwellProblem, DwellProblem]:
    return tool_problem(4.0, 2.0), tool_problem(1.5, 0.75)


def test_the_joint_operator_is_the_sum_and_its_adjoint_is_exact(tools: tuple[DwellProblem, DwellProblem]) -> None:
    joint = JointRemoval([tool.operator for tool in tools])
    random = np.random.default_rng(2)
    time_s, values = random.normal(size=joint.steps), random.normal(size=(30, 40))
    first, second = joint.blocks
    assert first.stop == second.start == tools[0].operator.steps
    np.testing.assert_allclose(joint(time_s), tools[0].operator(time_s[first]) + tools[1].operator(time_s[second]))
    assert float((joint(time_s) * values).sum()) == pytest.approx(float(time_s @ joint.adjoint(values)), rel=1e-10)


def test_two_tools_leave_less_than_the_large_and_are_quicker_than_the_small(
    tools: tuple[DwellProblem, DwellProblem],
) -> None:
    both = joint_problem(tools, tools[1].misfit)
    assert both.joined is not None
    assert not both.joined[tools[0].operator.steps - 1]
    found = {
        name: aim_at(problem, problem.rms_nm, Aim(0.05), start_s=problem.lower_s, regularisation=Regularisation())
        for name, problem in (("large", tools[0]), ("small", tools[1]), ("both", both))
    }
    assert found["both"].chosen.rms_nm < 0.5 * found["large"].chosen.rms_nm
    assert found["both"].chosen.rms_nm < found["small"].chosen.rms_nm
    assert found["both"].chosen.total_time_s < 0.8 * found["small"].chosen.total_time_s


@pytest.mark.parametrize("exactly", [True, False])
@pytest.mark.parametrize("seconds_per_nm", [3.0, 100.0])
def test_a_balance_is_the_least_of_time_and_valued_residual(
    exactly: bool, seconds_per_nm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = tool_problem(4.0, 2.0)
    regularisation = Regularisation(1e-8, 0.0)
    aim = Aim(seconds_per_nm=seconds_per_nm)
    if not exactly:
        monkeypatch.setattr("ibfctl.dwell.trade_off.compress", lambda problem: None)
    chosen = aim_at(problem, problem.rms_nm, aim, start_s=problem.lower_s, regularisation=regularisation).chosen
    slack = 1e-3 if exactly else 2e-2
    cost_s = chosen.total_time_s + seconds_per_nm * chosen.rms_nm
    for factor in (0.2, 0.5, 2.0, 5.0):
        descent = Descent(problem, regularisation, chosen.time_s)
        descent.advance(factor * chosen.price_nm2_s, 2000, 1e-9)
        assert cost_s < descent.time_s.sum() + seconds_per_nm * problem.rms_nm(descent.time_s) + slack * cost_s


def test_several_tools_have_no_one_grid_to_extend(tools: tuple[DwellProblem, DwellProblem]) -> None:
    with pytest.raises(TypeError, match="one tool"):
        extended_problem(joint_problem(tools, tools[1].misfit))
