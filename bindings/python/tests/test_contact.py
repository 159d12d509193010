"""Contacts: the same bits as Rust's, whichever way they are stepped."""

import copy
import threading

import numpy as np
import palpate
import pytest
from conftest import random_path


def same_bits(a, b) -> bool:
    return np.asarray(a).tobytes() == np.asarray(b).tobytes()


@pytest.mark.parametrize("rule", ["paper", "consistent", "exact"])
def test_rusts_bits(reference, drag, rule):
    body = palpate.Body.open(reference / "lump.body")
    trace = palpate.Contact(body, slip_rule=rule).rollout(drag)
    expected = np.fromfile(reference / f"{rule}.trace", dtype="<f8").reshape(-1, 11)
    assert len(trace) == len(expected) > 500
    energies = [trace[name] for name in ("work_j", "stored_j", "dissipated_j", "generated_j", "tank_j")]
    found = np.column_stack([trace["force_n"], trace["torque_nm"], *energies])
    assert same_bits(found, expected)
    assert np.abs(expected[:, :3]).max() > 0.1


def test_samples_make_rusts_body(reference, lump):
    assert same_bits(palpate.Body.open(reference / "lump.body").position_m, lump.position_m)


def test_step_is_rollout(lump, drag):
    trace = palpate.Contact(lump).rollout(drag)
    contact = palpate.Contact(lump)
    dt_s = np.diff(drag.time_s, prepend=drag.time_s[0])
    for row, position_m, dt in zip(trace, drag.position_m, dt_s):
        output = contact.step(position_m=position_m, dt_s=dt)
        assert same_bits(output.force_n, row["force_n"])
        assert output.flags == row["flags"]
        assert (-1 if output.element is None else output.element) == row["element"]
        assert same_bits(output.work_j, row["work_j"])
    assert contact.counters["steps"] == len(drag)
    assert trace["element"].max() >= 0 and trace["element"].min() == -1
    outside = trace["element"] < 0
    assert np.isnan(trace["contact_position_m"][outside]).all()
    assert not np.isnan(trace["contact_position_m"][~outside]).any()
    assert same_bits(trace.force_n, trace["force_n"])


def test_positions_of_any_kind(lump):
    forces = []
    for kind in (tuple, list, np.array, lambda x: np.array(x, dtype=np.float32)):
        contact = palpate.Contact(lump)
        contact.step(position_m=kind([0.0, 0.0, 0.0165]), dt_s=1e-3)
        output = contact.step(position_m=kind([0.0, 0.0, 0.0125]), dt_s=1e-3, orientation=[1, 0, 0, 0])
        forces.append(output.force_n[2])
    assert forces[0] > 0.1
    assert forces[0] == forces[1] == forces[2] == pytest.approx(forces[3], rel=1e-5)


@pytest.mark.parametrize("wrong", [(0.0, 0.0), [0, 0, 0, 0], np.zeros(2), np.zeros(4), "abc", 3, ("a", 0, 0)])
def test_positions_that_are_none(lump, wrong):
    contact = palpate.Contact(lump)
    with pytest.raises((palpate.ArgumentError, TypeError)):
        contact.step(position_m=wrong, dt_s=1e-3)
    assert contact.counters["steps"] == 0


def test_keywords_only(lump):
    with pytest.raises(TypeError):
        palpate.Contact(lump).step((0, 0, 0), 1e-3)


def test_what_is_not_finite_gives_a_flag(lump):
    output = palpate.Contact(lump).step(position_m=(np.nan, 0, 0), dt_s=1e-3)
    assert output.force_n == (0.0, 0.0, 0.0)
    assert output.flag_names == ["invalid_pose"] == palpate.flag_names(output.flags)
    assert output.flags == palpate.FLAGS["invalid_pose"]


def test_snapshots(lump):
    path = random_path(1)
    contact = palpate.Contact(lump)
    contact.rollout(path)
    snapshot, twin, other = contact.snapshot(), contact.copy(), copy.copy(contact)
    first = contact.rollout(path)
    assert not same_bits(first, palpate.Contact(lump).rollout(path))
    contact.restore(snapshot)
    for again in (contact, twin, other):
        assert same_bits(again.rollout(path), first)


def test_a_snapshot_of_another_body(lump, examples):
    other = palpate.Body.from_spec(examples / "cylinder-law.toml")
    with pytest.raises(palpate.ArgumentError, match="another body"):
        palpate.Contact(other).restore(palpate.Contact(lump).snapshot())


def test_a_trace_is_written_over(lump, drag):
    contact = palpate.Contact(lump)
    out = contact.rollout(drag)
    kept = out.copy()
    out["force_n"] = 0
    assert palpate.Contact(lump).rollout(drag, out=out) is out
    assert same_bits(out, kept)
    for wrong in (out[:-1], np.zeros((len(out), 21)), out[::2]):
        with pytest.raises(palpate.ArgumentError, match="out"):
            contact.rollout(drag, out=wrong)
    out.flags.writeable = False
    with pytest.raises(palpate.ArgumentError, match="written"):
        contact.rollout(drag, out=out)


def test_many_are_one_after_the_other(lump):
    paths = [random_path(seed, steps=300 + 7 * seed) for seed in range(40)]
    single = [palpate.Contact(lump).rollout(path) for path in paths]
    for threads in (None, 1, 2, 7):
        many = palpate.rollout_many(lump, paths, threads=threads)
        assert all(same_bits(a, b) for a, b in zip(many, single, strict=True))
    assert palpate.rollout_many(lump, []) == []


def test_many_from_a_moment(lump):
    contact = palpate.Contact(lump, slip_rule="paper", friction_scale=0.5)
    contact.rollout(random_path(3))
    paths = [random_path(seed) for seed in range(5)]
    expected = [contact.copy().rollout(path) for path in paths]
    many = palpate.rollout_many(lump, paths, start=contact)
    assert all(same_bits(a, b) for a, b in zip(many, expected, strict=True))


def test_keywords_change_the_force(lump, drag):
    usual = palpate.Contact(lump).rollout(drag)
    for keywords in ({"friction_scale": 0.2}, {"ablation": "both"}, {"slip_rule": "paper"}):
        other = palpate.Contact(lump, **keywords).rollout(drag)
        assert not same_bits(other, usual)
        assert same_bits(palpate.rollout_many(lump, [drag], **keywords)[0], other)
    with pytest.raises(palpate.ArgumentError, match="slip_rule"):
        palpate.Contact(lump, slip_rule="smooth")
    with pytest.raises(palpate.ArgumentError, match="ablation"):
        palpate.Contact(lump, ablation="all")
    with pytest.raises(palpate.ArgumentError, match="friction_scale"):
        palpate.Contact(lump, friction_scale=-1)
    with pytest.raises(palpate.ArgumentError, match="threads"):
        palpate.rollout_many(lump, [drag], threads=0)


def test_another_thread_is_told(lump):
    """The contact is entered by one thread at a time; the other does not wait and does not break it."""
    long = palpate.Path(position_m=np.tile(random_path(5).position_m, (500, 1)), dt_s=1e-3)
    contact = palpate.Contact(lump)
    worker = threading.Thread(target=contact.rollout, args=(long,))
    worker.start()
    told = 0
    while worker.is_alive():
        try:
            contact.step(position_m=(0, 0, 1), dt_s=0)
        except palpate.BusyError:
            told += 1
    worker.join()
    assert told > 0
    assert contact.counters["steps"] >= len(long)


def test_paths():
    positions = np.zeros((4, 3))
    path = palpate.Path(position_m=positions, time_s=[0, 1, 1, 2], orientation=np.tile([1.0, 0, 0, 0], (4, 1)))
    assert len(path) == 4 and path.time_s.tolist() == [0, 1, 1, 2] and path.orientation.shape == (4, 4)
    assert same_bits(palpate.Path(position_m=positions, dt_s=0.5).time_s, [0, 0.5, 1, 1.5])
    fortran = np.asfortranarray(np.arange(12.0).reshape(4, 3))
    assert same_bits(palpate.Path(position_m=fortran, dt_s=1).position_m, np.ascontiguousarray(fortran))
    for wrong, message in [
        ({"position_m": np.zeros((4, 2)), "dt_s": 1}, r"\(n, 3\)"),
        ({"position_m": positions}, "one of"),
        ({"position_m": positions, "dt_s": 1, "time_s": [0, 1, 2, 3]}, "one of"),
        ({"position_m": positions, "dt_s": -1}, "dt_s"),
        ({"position_m": positions, "time_s": [0, 1]}, "2 times for 4"),
        ({"position_m": positions, "time_s": [0, 2, 1, 3]}, r"time_s\[2\] comes before"),
        ({"position_m": positions, "time_s": [0, np.nan, 1, 3]}, r"time_s\[1\]"),
        ({"position_m": positions, "dt_s": 1, "orientation": np.zeros((3, 4))}, "3 quaternions"),
    ]:
        with pytest.raises(palpate.ArgumentError, match=message):
            palpate.Path(**wrong)
    with pytest.raises(palpate.InputError, match="nowhere.csv"):
        palpate.Path.open("nowhere.csv")
