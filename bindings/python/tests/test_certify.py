"""Certificates."""

import palpate
import pytest

BALL = """
[body.shape]
kind = "sphere"
radius_mm = 30
edge_length_mm = 9
[friction]
coefficient = 0.4
[deflection]
normal_max_mm = 8
lateral_max_mm = 4
steps = 4
[slip]
rule = "paper"
[response]
law = "paper-cylinder"
stiffness_n_per_m = 600
lateral_stiffness_n_per_m = 500
around = 0.0
along = 0.0
"""


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> palpate.Body:
    spec = tmp_path_factory.mktemp("ball") / "ball.toml"
    spec.write_text(BALL)
    return palpate.Body.from_spec(spec)


def test_a_ball_with_friction_holds_and_says_what_a_device_may_do(ball):
    heard = []
    found = ball.certify(evaluations=1500, damping_n_s_per_m=0.3, progress=lambda p: heard.append((p.done, p.total)))
    assert found["passive"]["holds"] and found["snap_free"]["holds"] and found["slip"] == "paper"
    assert 0 < found["passive"]["margin"] <= found["passive"]["found"]
    assert found["lipschitz_n_per_m"] >= found["lipschitz_found_n_per_m"] > 0
    # 2 b/T = 600 N/m = 200 k depth: 5 mm deep, where every place gives 100 k depth^2 = 1.5 N.
    assert found["device"]["depth_limit_m"] == pytest.approx(5e-3, abs=1e-9)
    assert found["device"]["force_limit_n"] == pytest.approx(1.5, abs=1e-9)
    count = len(ball.triangles)
    assert found["elements"] == count and heard == [(k + 1, count) for k in range(count)]


def test_a_device_by_name(ball):
    known = ball.certify(evaluations=50, device="touch")
    other = ball.certify(evaluations=50, device="touch", damping_n_s_per_m=7.0, delay_samples=0.0, position_error_m=0.0)
    assert known["device"]["rate_hz"] == 1000 and other["device"]["damping_n_s_per_m"] == 7.0
    assert known["device"]["damping_n_s_per_m"] < 7.0 and other["device"]["whole_depth"]
    assert ball.certify(evaluations=50)["device"] is None


def test_what_can_not_be_certified(ball):
    for wrong, words in [
        ({"step_m": 0}, "step_m"),
        ({"depth_m": -1}, "depth_m"),
        ({"device": "wand"}, "falcon"),
        ({"rate_hz": 1000}, "damping_n_s_per_m"),
        ({"device": "touch", "rate_hz": 0}, "rate_hz"),
        ({"slip_rule": "smooth"}, "slip_rule"),
        ({"threads": 0}, "threads"),
    ]:
        with pytest.raises(palpate.ArgumentError, match=words):
            ball.certify(**wrong)
    with pytest.raises(palpate.CancelledError):
        ball.certify(progress=lambda progress: progress.done < 5)
    with pytest.raises(ZeroDivisionError):
        ball.certify(progress=lambda progress: 1 / 0)
