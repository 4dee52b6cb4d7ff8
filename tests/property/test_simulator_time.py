"""However time is cut into pieces, the same commands at the same samples do the same."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from ibfctl_simulator.galil.controller import Controller
from ibfctl_simulator.galil.programs.memory import Program
from ibfctl_simulator.galil.servo import ServoModel
from ibfctl_simulator.galil.settings import Settings
from ibfctl_simulator.galil.switches import SwitchPlaces

PROGRAM = Program(
    [
        "#AUTO;n=0",
        "#L;WT 5;n=n+1",
        "IF(_SCA=32);SB 2;ENDIF;IF(_RPB>300);SB 3;ELSE;CB 3;ENDIF",
        "JP#L",
        "#LIMSWI;SB 4;RE 1",
        "#POSERR;SB 5;RE 1",
    ]
)
COMMANDS = st.sampled_from(
    """
    SH PVA=100,2000,40 PVA=80,-1500,33 PVB=-30,0,17 PVB=500,9000,64 BTA BTB BTAB PVA=0,0,0 PVB=0,0,0 PVA=0,0,-1
    JGA=5000 JGB=-9000 BGA BGB STA ST AB1 PRB=900 PAA=-700 HMA FEB FIA MOA CMAB CD90,-50=5 CD0,0=0 DT2 DT-1
    PTA=1 PTB=1 OEA=1 OEB=2 ERA=40 ERB=16384 DPA=9 FLA=150 FLB=2147483647 TM500 TM1000 SPA=9000 DCA=50000 LDB=3
    """.split()  # noqa: SIM905
)
SERVOS = st.sampled_from(
    [
        ServoModel(),
        ServoModel(kind="lag", time_constant_s=0.01),
        ServoModel(kind="second_order", acceleration_limit_counts_s2=3e5, encoder_noise_counts=0.7),
    ]
)


def picture(controller: Controller) -> tuple[object, ...]:
    state = controller.state
    axes = [
        (axis.commanded_counts, axis.encoder_counts, axis.stop_code, axis.mode, axis.buffer.free, axis.buffer.executed)
        for axis in state.axes
    ]
    return axes, state.outputs, dict(state.variables), controller.reply("QR", "A")


@given(
    steps=st.lists(st.one_of(COMMANDS, st.integers(1, 120)), max_size=25),
    cuts=st.lists(st.integers(1, 50), min_size=1, max_size=5),
    servo=SERVOS,
)
@settings(max_examples=300, deadline=None)
def test_no_result_depends_on_how_time_is_cut(steps, cuts, servo):
    machines = [
        Controller(
            Settings(motor_on_at_start=True, servo=servo, switches=SwitchPlaces(900, -900, 60, 400)), program=PROGRAM
        )
        for _ in range(2)
    ]
    turn = 0
    for step in [*steps, 400]:
        if isinstance(step, str):
            replies = [machine.reply(step, "A") for machine in machines]
            assert replies[0] == replies[1]
            continue
        machines[0].advance(step)
        while step > 0:
            piece = min(step, cuts[turn % len(cuts)])
            machines[1].advance(piece)
            step, turn = step - piece, turn + 1
        assert picture(machines[0]) == picture(machines[1])
