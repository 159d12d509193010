"""Bodies: made, kept, inspected; and what is said when they are wrong."""

import pickle

import numpy as np
import palpate
import pytest


def columns(file):
    rows = [line.split(",") for line in file.read_text().splitlines() if line and not line.startswith("#")]
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


def test_arrays_are_views(lump):
    assert lump.position_m.shape == lump.inward.shape == (len(lump.position_m), 3)
    assert np.allclose(np.linalg.norm(lump.inward, axis=1), 1, atol=1e-12)
    assert lump.triangles.dtype == np.uint32 and lump.triangles.max() == len(lump.position_m) - 1
    for array in (lump.position_m, lump.inward, lump.triangles):
        assert not array.flags.owndata
        with pytest.raises(ValueError):
            array[0, 0] = 1
        with pytest.raises(ValueError):
            array.setflags(write=True)
    low, high = lump.bounds_m
    assert (low == lump.position_m.min(axis=0)).all() and (high == lump.position_m.max(axis=0)).all()
    # Normals point in: against the way from the middle.
    a, b, c = (lump.position_m[lump.triangles[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", outward, lump.inward[lump.triangles[:, 0]]) < 0).mean() > 0.99


def test_views_outlive_their_body(examples):
    positions = palpate.Body.from_spec(examples / "cylinder-law.toml").position_m
    assert np.allclose(np.hypot(positions[:, 0], positions[:, 1]), 0.03)


def test_kept_and_opened(lump, drag, tmp_path):
    lump.save(tmp_path / "lump.body")
    expected = palpate.Contact(lump).rollout(drag).tobytes()
    for again in (
        palpate.Body.open(tmp_path / "lump.body"),
        palpate.Body.open(str(tmp_path / "lump.body")),
        palpate.Body.from_bytes(lump.to_bytes()),
        pickle.loads(pickle.dumps(lump)),
    ):
        assert palpate.Contact(again).rollout(drag).tobytes() == expected


def test_samples_by_column(lump, examples, drag):
    position_m, triangles = palpate.read_mesh(examples / "fit/lump.obj", unit="mm")
    table = columns(examples / "fit/samples.csv")
    numbers = {k: v if k in ("point", "component") else np.array(v, dtype=float) for k, v in table.items()}
    body = palpate.Body.from_samples(position_m=position_m, triangles=triangles.astype(np.int64), samples=numbers)
    expected = palpate.Contact(lump).rollout(drag).tobytes()
    assert palpate.Contact(body).rollout(drag).tobytes() == expected
    kinds = [(k, "U16" if k in ("point", "component") else "f8") for k in table]
    structured = np.array(list(zip(*numbers.values())), dtype=kinds)
    body = palpate.Body.from_samples(position_m=position_m, triangles=triangles, samples=structured)
    assert palpate.Contact(body).rollout(drag).tobytes() == expected

    def with_samples(samples, **more):
        return palpate.Body.from_samples(position_m=position_m, triangles=triangles, samples=samples, **more)

    lacking = {k: v for k, v in numbers.items() if k != "value"}
    with pytest.raises(palpate.ArgumentError, match="no column \"value\""):
        with_samples(lacking)
    with pytest.raises(palpate.ArgumentError, match="component 0 is \"sideways\""):
        with_samples({**numbers, "component": ["sideways"] * len(table["point"])})
    with pytest.raises(palpate.ArgumentError, match="has 2 rows"):
        with_samples({**numbers, "value": [1.0, 2.0]})
    with pytest.raises(palpate.InputError, match="line 1"):
        with_samples({**numbers, "deflection_m": -numbers["deflection_m"]})
    with pytest.raises(palpate.InputError, match="nowhere.csv"):
        with_samples("nowhere.csv")
    with pytest.raises(palpate.ArgumentError, match="interpolation"):
        with_samples(numbers, interpolation="cubic")
    with pytest.raises(palpate.ArgumentError, match=r"triangles\[0\] names vertex -1"):
        palpate.Body.from_samples(position_m=position_m, triangles=[[-1, 0, 1]], samples=numbers)
    with pytest.raises(palpate.InputError):
        palpate.Body.from_samples(position_m=position_m, triangles=[[0, 1, 2]], samples=numbers)
    sphere = with_samples(numbers, tool_radius_m=0.004, slip_rule="paper", tank=False, interpolation="linear")
    assert (sphere.tool, sphere.tool_radius_m, sphere.slip_rule, sphere.has_tank) == ("sphere", 0.004, "paper", False)


def test_inspection(lump, examples):
    assert len(lump.test_point_nodes) == 6
    assert lump.vertex_count == len(lump.position_m)
    assert not lump.is_coupled and lump.is_isotropic and lump.has_tank and lump.slip_rule == "consistent"
    top = lump.test_point_nodes[0]
    curves = lump.node_curves(int(top), deflection_m=[0.0, 0.001, 0.002])
    # What examples/fit/samples.csv says of the point `top`.
    assert curves["normal_n"].tolist() == pytest.approx([0, 0.0927, 0.3816])
    assert (np.diff(lump.stiffness_by_depth[:, 1]) >= 0).all()
    assert lump.stiffness_by_depth[-1].tolist() == [lump.depth_max_m, lump.stiffness_max_n_per_m]
    assert lump.stiffness_aside_n_per_m > 0
    with pytest.raises(palpate.InputError, match="node 1000000"):
        lump.node_curves(1_000_000, deflection_m=[0.0])
    assert "6 test points" in repr(lump) and "6 test points" in lump._repr_html_()
    body = palpate.Body.from_spec(examples / "cylinder-law.toml")
    assert len(body.triangles) == 528 and "paper-cylinder" in body.provenance["spec"]


def test_damaged_and_missing_files(lump, tmp_path):
    whole = lump.to_bytes()
    for wrong in (b"", whole[:100], whole[:-8], b"\xff" * 64):
        with pytest.raises(palpate.InputError):
            palpate.Body.from_bytes(wrong)
    with pytest.raises(palpate.InputError, match="none.body"):
        palpate.Body.open(tmp_path / "none.body")
    (tmp_path / "wrong.toml").write_text("[body]\nmesh = 3\n")
    with pytest.raises(palpate.InputError, match="wrong.toml"):
        palpate.Body.from_spec(tmp_path / "wrong.toml")
    with pytest.raises(palpate.ArgumentError, match="unit"):
        palpate.read_mesh("lump.obj", unit="inch")


def test_one_tree_of_exceptions():
    children = [palpate.InputError, palpate.ArgumentError, palpate.BusyError, palpate.CancelledError]
    assert all(issubclass(child, palpate.Error) for child in children)
    assert issubclass(palpate.Error, Exception)


SPEC = """
[body.shape]
kind = "block"
size_mm = [20, 20, 10]
edge_length_mm = 5

[[body.fixed]]
half_space = { point_mm = [0, 0, -5], normal = [0, 0, -1] }

[material]
model = "neo-hookean"
young_modulus_pa = 5000
poisson_ratio = 0.45

[tool]
shape = "sphere"
radius_mm = 4

[friction]
coefficient = 0.2

[deflection]
normal_max_mm = 1
lateral_max_mm = 0.5
steps = 2

[test_points]
count = 3

[mesh]
element_size_mm = 5
"""


def test_simulated(tmp_path):
    """A small block: progress is heard in this thread, a call that was ended goes on from where it was."""
    (tmp_path / "block.toml").write_text(SPEC)
    heard = []

    def stop_after_one(progress):
        heard.append(progress)
        return progress.done < 1

    with pytest.raises(palpate.CancelledError):
        palpate.Body.from_spec(
            tmp_path / "block.toml", progress=stop_after_one, work_folder=tmp_path / "work", threads=1
        )
    assert heard[-1].done == 1 and heard[-1].total == 3
    heard.clear()
    body = palpate.Body.from_spec(tmp_path / "block.toml", progress=heard.append, work_folder=tmp_path / "work")
    assert next(p.done for p in heard if p.total) >= 1 and heard[-1].done == heard[-1].total
    assert body.tool == "sphere" and body.stiffness_max_n_per_m > 1
    with pytest.raises(ZeroDivisionError):
        palpate.Body.from_spec(tmp_path / "block.toml", progress=lambda progress: 1 / 0)
    compared(body, tmp_path / "block.toml")


def compared(body, spec):
    """With what is simulated on paths that the body was not made of."""
    heard = []
    found = body.validate(spec, paths=2, seed=3, progress=heard.append)
    assert len(found["paths"]) + found["failed"] == 2 and heard[-1].done == heard[-1].total == 2
    assert found["seed"] == 3 and found["history"] == "coulomb"
    assert found["paths"][0]["largest_force_n"] > 0 and found["sources"][0]["source"] == "body"
    again = body.validate(spec, paths=2, seed=3, threads=1)
    assert again == found
    for wrong, words in [({"history": "slow"}, "history"), ({"paths": 0}, "paths"), ({"steps": 0}, "steps")]:
        with pytest.raises(palpate.ArgumentError, match=words):
            body.validate(spec, **wrong)
    with pytest.raises(palpate.InputError, match="nowhere.toml"):
        body.validate("nowhere.toml")
    with pytest.raises(palpate.CancelledError):
        body.validate(spec, paths=40, progress=lambda progress: progress.done < 1)
