"""Sessions with a simulated device against the clock, and their recordings."""

import math
import threading
import time

import numpy as np
import palpate
import pytest

# Machines of tests are busy: nothing ends a session but what the test asks for.
QUIET = {
    "device": "simulated:touch",
    "real_time": {"priority": 0, "core": -1, "lock_memory": False, "spin_s": 0},
    "patience": {"late_s": 10, "finder_s": 60, "pose_s": 10},
    "safety": {"silence_s": 5, "soft_start_s": 0.05},
}


def test_a_session_from_beginning_to_end(lump, tmp_path):
    lump.save(tmp_path / "lump.body")
    body = palpate.Body.open(tmp_path / "lump.body")
    recording = tmp_path / "a.rec"
    session = palpate.Session(body, **QUIET, seconds=0.5, motion="press", record=recording)
    assert repr(session) == "<palpate.Session: prepared>"
    # Prepared: no file, no record, no force.
    assert session.latest() is None and len(session.history()) == 0 and not recording.exists()
    with pytest.raises(palpate.SessionError, match="start"):
        session.wait(timeout_s=0)
    with pytest.raises(palpate.SessionError, match="start"):
        session.pause()
    assert session.settings["seconds"] == 0.5 and session.settings["safety"]["silence_s"] == 5
    session.start()
    with pytest.raises(palpate.SessionError, match="started before"):
        session.start()
    begun = time.monotonic()
    assert session.wait()
    assert time.monotonic() - begun < 30
    outcome = session.close()
    # Both ends of 0.5 s have a period, and up to three more bring the force to zero; a busy machine may leave some out.
    assert outcome.is_well and 20 < outcome.periods == session.summary()["periods"] <= 504, outcome
    assert outcome.recorded == outcome.periods and outcome.trouble is None
    assert session.close().periods == outcome.periods and "closed" in repr(session)
    # What was last is still there.
    last = session.latest()
    assert last.dtype == palpate.RECORD_DTYPE and last.number + 1 >= outcome.periods
    # Where the loop was kept from its last periods, the fade comes late.
    assert 0.4 < last["time_s"] < 10
    assert len(session.history()) > 2 and (np.diff(session.history().number.astype(int)) > 0).all()
    # The file: a header, then each period's record, then why it ended.
    data = recording.read_bytes()
    assert data.startswith(b"palprec\n") and len(data) > outcome.periods * palpate.RECORD_DTYPE.itemsize
    assert b"lump.body" in data
    with pytest.raises(palpate.SessionError, match="a.rec"):
        palpate.Session(body, **QUIET, record=recording)


def test_with_starts_reads_steers_and_ends(lump):
    with palpate.Session(lump, **QUIET, motion="hold", seconds=600) as session:
        assert not session.wait(timeout_s=0.2)
        first = session.latest()
        assert first is not None and np.isfinite(first.device_position_m).all()
        session.set_friction_scale(0.5)
        session.set_force_limit(force_max_n=1.0)
        session.set_slip_rule("exact")
        deadline = time.monotonic() + 20
        while (now := session.latest()).friction_scale != 0.5 or now.slip_rule_code == first.slip_rule_code:
            assert time.monotonic() < deadline
            session.wait(timeout_s=0.01)
        with pytest.raises(palpate.SessionError):
            session.set_force_limit(force_max_n=1e6)
        with pytest.raises(palpate.SessionError):
            session.set_friction_scale(-1)
        with pytest.raises(palpate.ArgumentError, match="slip_rule"):
            session.set_slip_rule("smooth")
        session.change_body(lump)
        session.pause()
        session.resume()
        assert session.outcome is None
    assert session.outcome.is_well and "asked" in session.outcome.end
    assert session.outcome.periods > 10 and session.latest().number > first.number
    with pytest.raises(palpate.SessionError, match="closed"):
        session.pause()


def test_an_exception_ends_it(lump):
    with pytest.raises(ZeroDivisionError):
        with palpate.Session(lump, **QUIET, seconds=600) as session:
            session.wait(timeout_s=0.05)
            1 / 0
    assert session.outcome.is_well


def test_the_interpreter_is_free_while_it_waits(lump):
    with palpate.Session(lump, **QUIET, seconds=600) as session:
        over = []
        waiter = threading.Thread(target=lambda: over.append(session.wait()))
        waiter.start()
        for _ in range(100):
            assert session.latest() is None or session.latest().number >= 0
        session.stop()
        waiter.join(timeout=20)
        assert over == [True]
    with palpate.Session(lump, **QUIET, seconds=600) as session:
        session.stop_at_once()
        assert session.wait(timeout_s=20)
    assert "emergency" in session.outcome.end and not session.outcome.is_well


def test_settings_that_are_none(lump):
    for settings, words in [
        ({"colour": "red"}, "colour"),
        ({"safety": {"force_max": 1}}, "force_max"),
        ({"seconds": "long"}, "settings"),
        ({"seconds": math.nan}, "settings"),
        ({"device": "wand"}, "simulated"),
    ]:
        with pytest.raises(palpate.ArgumentError, match=words):
            palpate.Session(lump, **settings)
    with pytest.raises(palpate.SessionError, match="rate"):
        palpate.Session(lump, rate_hz=1)
    with pytest.raises(palpate.SessionError):
        palpate.Session(lump, clock="virtual")
    # Never started.
    session = palpate.Session(lump, **QUIET)
    assert session.close() is None and session.outcome is None
    assert palpate.Session(lump, **QUIET, workspace={"offset_m": np.zeros(3)}).settings["workspace"]["offset_m"] == [0, 0, 0]
