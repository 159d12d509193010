"""The package as a whole: stubs, documentation, pictures."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import palpate
import pytest

HERE = Path(__file__).resolve().parents[1]
STUBS = ast.parse((HERE / "python/palpate/_palpate.pyi").read_text(encoding="utf-8"))


def classes():
    return [node for node in STUBS.body if isinstance(node, ast.ClassDef)]


def functions(node):
    return [f for f in node.body if isinstance(f, ast.FunctionDef)]


def parameters(function: ast.FunctionDef):
    """Names and kinds, without the object itself."""
    a = function.args
    plain = [p.arg for p in a.posonlyargs + a.args if p.arg not in ("self", "cls")]
    return plain, [p.arg for p in a.kwonlyargs] + ([a.kwarg.arg] if a.kwarg else [])


def really(function):
    kinds = inspect.Parameter
    given = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
    keywords = (kinds.KEYWORD_ONLY, kinds.VAR_KEYWORD)
    plain = [p.name for p in given if p.kind not in keywords]
    return plain, [p.name for p in given if p.kind in keywords]


def test_stubs_say_what_is_there():
    names = {node.name for node in classes()} | {f.name for f in functions(STUBS)}
    names |= {node.target.id for node in STUBS.body if isinstance(node, ast.AnnAssign) and node.value is None}
    assert names == set(palpate.__all__)
    for function in functions(STUBS):
        assert parameters(function) == really(getattr(palpate, function.name)), function.name
    for node in classes():
        thing = getattr(palpate, node.name)
        told = {f.name for f in functions(node) if not f.name.startswith("_")}
        there = {name for name in vars(thing) if not name.startswith("_")}
        assert told == there, node.name
        for f in functions(node):
            if f.name == "__new__":
                assert parameters(f) == really(thing), node.name
            elif not f.name.startswith("_") and not f.decorator_list:
                assert parameters(f) == really(getattr(thing, f.name)), f"{node.name}.{f.name}"


def test_the_version_says_commit_and_features():
    assert palpate.VERSION.startswith(palpate.__version__ + " (")
    assert "features: devices, simulate" in palpate.VERSION


def test_the_reference_is_the_packages():
    script = [sys.executable, str(HERE / "reference.py"), "--check"]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_trace_dtype(lump, drag):
    trace = palpate.Contact(lump).rollout(drag)
    assert trace.dtype == palpate.TRACE_DTYPE
    assert trace.dtype.itemsize == 168
    error = trace["work_j"] - trace["stored_j"] - trace["dissipated_j"] - trace["relaxed_j"]
    assert abs(error).max() < 1e-9 * trace["work_j"].max()


def test_plots(lump, drag, examples):
    pytest.importorskip("matplotlib").use("agg")
    import matplotlib.pyplot as plt
    import palpate.plot

    coloured = palpate.plot.body(lump, node_values=lump.position_m[:, 2], label="height, m")
    assert coloured.collections
    drawn = palpate.plot.curves(lump)
    assert len(drawn.lines) == 6
    trace = palpate.Contact(lump).rollout(drag)
    drawn = palpate.plot.trace(trace, path=drag)
    assert [line.get_label() for line in drawn.lines] == ["x", "y", "z", "size"]
    assert (drawn.lines[2].get_ydata() == trace["force_n"][:, 2]).all()
    with pytest.raises(palpate.ArgumentError, match="path"):
        palpate.plot.trace(trace[1:], path=drag)
    with pytest.raises(palpate.ArgumentError, match="node_values"):
        palpate.plot.body(lump, node_values=[1.0])
    plt.close("all")
